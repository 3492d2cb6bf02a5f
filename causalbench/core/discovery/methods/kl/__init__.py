"""The paper's discoverer: reward models, KL divergence, Algorithm 2."""
