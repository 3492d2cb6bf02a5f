"""Step 2 of Algorithm 1: one reward model per (action, term) pair, all pairs of a stage in one network.

p(r_j | s, a) = Normal(mu, sigma) (paper, Training Reward Prediction Models and appendix). The pairs are independent:
their weights stand side by side in one batched matrix product. Samples with frames go through the paper's convolutions
first, which every pair has of its own, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from causalbench.core.discovery.reward_model.network import LOG_SIGMA_MAX, forward
from causalbench.core.discovery.samples.transitions import Samples
from causalbench.core.networks.encoder import Encoder

NO_SENSOR = Encoder()
FRAMES_AT_ONCE = 256  # samples of which all pairs see the frames at a time, for memory


@dataclass(frozen=True)
class RewardModels:
    """Trained models of every (action, term) pair of one stage, action-major: pair p = k * n_terms + j.

    Rewards are in deviations of the term in D_random. `epochs` is how long training ran.
    """

    weights: list[Tensor]
    input_mean: Tensor
    input_scale: Tensor
    n_terms: int
    log_sigma_min: float
    epochs: int
    encoder: Encoder = NO_SENSOR

    def predict(self, samples: Samples, k: int) -> tuple[Tensor, Tensor]:
        """Mean and log sigma (n_terms, n) of action k's models, in deviations of the term."""
        rows = slice(k * self.n_terms, (k + 1) * self.n_terms)
        inputs = (model_inputs(samples) - self.input_mean) / self.input_scale
        weights, out = [w[rows] for w in self.weights], []
        size = FRAMES_AT_ONCE if self.encoder.sensor else len(samples)
        with torch.no_grad():
            for part in torch.split(torch.arange(len(samples)), size):
                x = with_frames(inputs[part], samples, part).to(weights[0].device)
                out.append(forward(*self.encoder(weights, x.expand(self.n_terms, -1, -1))).cpu())
        both = torch.cat(out, 1)
        return both[..., 0], both[..., 1].clamp(self.log_sigma_min, LOG_SIGMA_MAX)


def scaled_rewards(samples: Samples, reference: Samples) -> NDArray[np.float32]:
    """(n, n_terms) rewards of `samples` about the mean and in deviations of `reference`."""
    return (samples.rewards - reference.rewards.mean(0)) / reference.term_scale()[0].astype(np.float32)


def model_inputs(samples: Samples) -> Tensor:
    """(n, d) states and actions."""
    return torch.from_numpy(np.concatenate([samples.states, samples.actions], axis=1))


def with_frames(inputs: Tensor, samples: Samples, rows: Tensor) -> Tensor:
    """`inputs` (m, d) of the samples `rows` with their frames beside them, as `Encoder` takes them."""
    if not samples.frames:
        return inputs
    return torch.cat([inputs, torch.from_numpy(samples.frames_of(rows.numpy())).float()], 1)
