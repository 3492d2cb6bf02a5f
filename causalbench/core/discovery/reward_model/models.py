"""Step 2 of Algorithm 1: one reward model per (action, term) pair, all pairs of a stage trained as one network.

p(r_j | s, a) = Normal(mu, sigma) through F(128)-F(128)-F(128)-(F(1), F(1)), loss the negative log likelihood
(paper, Training Reward Prediction Models and appendix). The pairs are independent: their weights stand side by
side in one batched matrix product and the loss is the sum over pairs. Samples with frames go through the paper's
convolutions first, which every pair has of its own, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from causalbench.core.discovery.reward_model.settings import RewardModelSettings
from causalbench.core.discovery.samples.transitions import Samples
from causalbench.core.networks.encoder import Encoder, device_for

HIDDEN = (128, 128, 128)
HELD_OUT = 0.1  # share of the training data on which early stopping judges
LOG_SIGMA_MAX = 4.0
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
        inputs = (_inputs(samples) - self.input_mean) / self.input_scale
        weights, out = [w[rows] for w in self.weights], []
        size = FRAMES_AT_ONCE if self.encoder.sensor else len(samples)
        with torch.no_grad():
            for part in torch.split(torch.arange(len(samples)), size):
                x = _with_frames(inputs[part], samples, part).to(weights[0].device)
                out.append(_forward(*self.encoder(weights, x.expand(self.n_terms, -1, -1))).cpu())
        both = torch.cat(out, 1)
        return both[..., 0], both[..., 1].clamp(self.log_sigma_min, LOG_SIGMA_MAX)


def train_reward_models(
    data: Sequence[tuple[Samples, Samples]],
    settings: RewardModelSettings,
    seed: int,
    on_progress: Callable[[float], None],
) -> RewardModels:
    """Train on D_random together with each D_do[a_k] (`data[k]`, sizes equal for all k), early stopping per pair.

    Each pair keeps the weights of its best held-out likelihood; training ends when no pair has improved for
    `settings.patience` epochs (0: after `settings.max_epochs`, last weights kept, as in the paper).
    """
    pairs = [random.joined(do) for random, do in data]
    return fit_reward_models(pairs, data[0][0], settings, seed, on_progress)


def fit_reward_models(
    data: Sequence[Samples],
    reference: Samples,
    settings: RewardModelSettings,
    seed: int,
    on_progress: Callable[[float], None],
) -> RewardModels:
    """Models of every term on each of `data` (all of one length), rewards in deviations of the term in `reference`."""
    generator = torch.Generator().manual_seed(seed)
    n_actions, n_terms = len(data), reference.rewards.shape[1]
    inputs = torch.stack([_inputs(samples) for samples in data])  # (K, N, d)
    mean = inputs.mean((0, 1))
    scale = inputs.std((0, 1))
    scale = torch.where(scale < 1e-6, torch.ones_like(scale), scale)
    inputs = (inputs - mean) / scale
    targets = torch.stack([torch.from_numpy(scaled_rewards(samples, reference)) for samples in data])  # (K, N, J)
    targets = targets.permute(0, 2, 1).reshape(n_actions * n_terms, -1, 1)

    encoder, device = Encoder(reference.sensor), device_for(reference.sensor)
    n_pairs, n_seen = n_actions * n_terms, inputs.shape[2] + encoder.n_features
    weights = encoder.initial_weights(generator, n_pairs) + _initial_weights(n_pairs, n_seen, generator)
    weights, targets = [w.to(device) for w in weights], targets.to(device)
    for w in weights:
        w.grad = torch.empty_like(w)
        w.requires_grad_(bool(encoder.sensor))  # convolutions are left to autograd
    best_weights = [w.detach().clone() for w in weights]
    best_loss = torch.full((n_pairs,), math.inf, device=device)
    optimizer = torch.optim.Adam(weights, settings.learning_rate, fused=True)
    order = torch.randperm(inputs.shape[1], generator=generator)
    n_held_out = round(HELD_OUT * len(order)) if settings.patience else 0
    held_out, train = order[:n_held_out], order[n_held_out:]
    log_sigma_min = math.log(settings.sigma_train)

    def batch(rows: Tensor) -> Tensor:
        x = inputs.index_select(1, rows)
        if encoder.sensor:
            x = torch.stack([_with_frames(x[k], samples, rows) for k, samples in enumerate(data)]).to(device)
        return x.repeat_interleave(n_terms, 0)

    def loss(rows: Tensor) -> Tensor:
        out = _forward(*encoder(weights, batch(rows)))
        return _negative_log_likelihood(out, targets[:, rows], log_sigma_min)

    def held_out_loss() -> Tensor:
        parts = torch.split(held_out, FRAMES_AT_ONCE if encoder.sensor else len(held_out))
        return torch.stack([loss(rows) * (len(rows) / len(held_out)) for rows in parts]).sum(0)

    space: dict[int, list[Tensor]] = {}  # by batch size
    stale = epoch = 0
    for epoch in range(1, settings.max_epochs + 1):
        shuffled = train[torch.randperm(len(train), generator=generator)]
        for rows in torch.split(shuffled, settings.batch_size):
            if encoder.sensor:
                for w, gradient in zip(weights, torch.autograd.grad(loss(rows).sum(), weights), strict=True):
                    w.grad = gradient
                optimizer.step()
                continue
            if len(rows) not in space:
                space[len(rows)] = [torch.empty(n_actions * n_terms, len(rows), width) for width in HIDDEN * 2]
            _set_gradients(weights, batch(rows), targets.index_select(1, rows), log_sigma_min, space[len(rows)])
            optimizer.step()
        on_progress(epoch / settings.max_epochs)
        if not settings.patience:
            continue
        with torch.no_grad():
            now = held_out_loss()
            better = now < best_loss
            best_loss = torch.where(better, now, best_loss)
            for kept, w in zip(best_weights, weights, strict=True):
                kept[better] = w[better]
        stale = 0 if better.float().mean() > 0.2 else stale + 1
        if stale >= settings.patience:
            break
    kept_weights = best_weights if settings.patience else [w.detach() for w in weights]
    return RewardModels(kept_weights, mean, scale, n_terms, log_sigma_min, epoch, encoder)


def scaled_rewards(samples: Samples, reference: Samples) -> NDArray[np.float32]:
    """(n, n_terms) rewards of `samples` about the mean and in deviations of `reference`."""
    return (samples.rewards - reference.rewards.mean(0)) / reference.term_scale()[0].astype(np.float32)


def _inputs(samples: Samples) -> Tensor:
    return torch.from_numpy(np.concatenate([samples.states, samples.actions], axis=1))


def _with_frames(inputs: Tensor, samples: Samples, rows: Tensor) -> Tensor:
    """`inputs` (m, d) of the samples `rows` with their frames beside them, as `Encoder` takes them."""
    if not samples.frames:
        return inputs
    return torch.cat([inputs, torch.from_numpy(samples.frames_of(rows.numpy())).float()], 1)


def _initial_weights(pairs: int, n_inputs: int, generator: torch.Generator) -> list[Tensor]:
    weights = []
    sizes = (n_inputs, *HIDDEN, 2)
    for fan_in, fan_out in pairwise(sizes):
        bound = 1 / math.sqrt(fan_in)  # torch.nn.Linear's own initialisation
        for rows in (fan_in, 1):
            uniform = torch.rand(pairs, rows, fan_out, generator=generator)
            weights.append((uniform * 2 - 1) * bound)
    return weights


def _forward(weights: list[Tensor], x: Tensor) -> Tensor:
    """(pairs, n, 2) means and log sigmas from inputs (pairs, n, d)."""
    for kernel, bias in zip(weights[:-2:2], weights[1:-2:2], strict=True):
        x = torch.baddbmm(bias, x, kernel).relu()
    return torch.baddbmm(weights[-1], x, weights[-2])


@torch.no_grad()
def _set_gradients(
    weights: list[Tensor], x: Tensor, target: Tensor, log_sigma_min: float, space: Sequence[Tensor]
) -> None:
    """Set the gradient of the summed loss of a batch (pairs, n, d) in every weight, working in `space`.

    Backpropagation written out: autograd does the same products, to the bit, but takes new memory for each, and memory
    is what this waits for. `space` has two tensors of every hidden layer's shape.
    """
    layers = [x]
    for kernel, bias, out in zip(weights[:-2:2], weights[1:-2:2], space[: len(HIDDEN)], strict=True):
        layers.append(torch.baddbmm(bias, layers[-1], kernel, out=out).relu_())
    prediction = torch.baddbmm(weights[-1], layers[-1], weights[-2]).requires_grad_()
    with torch.enable_grad():
        loss = _negative_log_likelihood(prediction, target, log_sigma_min).sum()
    (gradient,) = torch.autograd.grad(loss, prediction)
    for i in reversed(range(len(layers))):
        torch.bmm(layers[i].mT, gradient, out=weights[2 * i].grad)
        torch.sum(gradient, 1, keepdim=True, out=weights[2 * i + 1].grad)
        if i:
            gradient = torch.bmm(gradient, weights[2 * i].mT, out=space[len(HIDDEN) + i - 1])
            torch.ops.aten.threshold_backward.grad_input(gradient, layers[i], 0, grad_input=gradient)


def _negative_log_likelihood(out: Tensor, target: Tensor, log_sigma_min: float) -> Tensor:
    """(pairs,) mean negative log likelihood, up to a constant."""
    log_sigma = out[..., 1:].clamp(log_sigma_min, LOG_SIGMA_MAX)
    return (0.5 * ((target - out[..., :1]) / log_sigma.exp()) ** 2 + log_sigma).mean((1, 2))
