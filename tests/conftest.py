"""Settings that every test shares."""

import torch

# Two threads in each of several test processes on a few cores wait for each other: up to 50 times slower.
torch.set_num_threads(1)
