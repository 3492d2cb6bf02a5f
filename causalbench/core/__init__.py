"""The simulator-free heart: what a scene offers, tasks, the environment, causal discovery, learners."""
