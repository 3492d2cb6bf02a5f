"""Reference rows: stable-baselines3's own agents."""
