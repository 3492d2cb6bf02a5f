"""Training of the reward models of a stage: all pairs together, early stopping per pair."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from causalbench.core.discovery.reward_model.models import (
    FRAMES_AT_ONCE,
    RewardModels,
    model_inputs,
    scaled_rewards,
    with_frames,
)
from causalbench.core.discovery.reward_model.network import (
    forward,
    initial_weights,
    negative_log_likelihood,
    set_gradients,
    working_space,
)
from causalbench.core.discovery.reward_model.settings import RewardModelSettings
from causalbench.core.discovery.samples.transitions import Samples
from causalbench.core.networks.encoder import Encoder, device_for

HELD_OUT = 0.1  # share of the training data on which early stopping judges
STILL_LEARNING = 0.2  # training goes on as long as more than this share of the pairs improves


def train_reward_models(
    data: Sequence[tuple[Samples, Samples]],
    settings: RewardModelSettings,
    seed: int,
    on_progress: Callable[[float], None],
) -> RewardModels:
    """Train on D_random together with each D_do[a_k] (`data[k]`, sizes equal for all k), early stopping per pair.

    Each pair keeps the weights of its best held-out likelihood; training ends when hardly a pair has improved for
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
    table = _Table(data, reference)
    fit = _Fit(table, settings, torch.Generator().manual_seed(seed))
    stale = epoch = 0
    for epoch in range(1, settings.max_epochs + 1):
        fit.epoch()
        on_progress(epoch / settings.max_epochs)
        if not settings.patience:
            continue
        stale = 0 if fit.judge() else stale + 1
        if stale >= settings.patience:
            break
    weights = fit.best_weights if settings.patience else [w.detach() for w in fit.weights]
    return RewardModels(weights, table.mean, table.scale, table.n_terms, fit.log_sigma_min, epoch, table.encoder)


class _Table:
    """Inputs and targets of all pairs, standardised; `encoder` reads the frames, if there are any."""

    def __init__(self, data: Sequence[Samples], reference: Samples) -> None:
        self.data, self.n_terms = data, reference.rewards.shape[1]
        self.encoder, self.device = Encoder(reference.sensor), device_for(reference.sensor)
        inputs = torch.stack([model_inputs(samples) for samples in data])  # (K, N, d)
        self.mean = inputs.mean((0, 1))
        scale = inputs.std((0, 1))
        self.scale = torch.where(scale < 1e-6, torch.ones_like(scale), scale)
        self.inputs = (inputs - self.mean) / self.scale
        targets = torch.stack([torch.from_numpy(scaled_rewards(samples, reference)) for samples in data])  # (K, N, J)
        self.n_pairs, self.n_samples = len(data) * self.n_terms, inputs.shape[1]
        self.targets = targets.permute(0, 2, 1).reshape(self.n_pairs, -1, 1).to(self.device)

    def initial_weights(self, generator: torch.Generator) -> list[Tensor]:
        """Of the convolutions, where there are frames, and of the layers behind them."""
        n_inputs = self.inputs.shape[2] + self.encoder.n_features
        weights = self.encoder.initial_weights(generator, self.n_pairs)
        weights += initial_weights(self.n_pairs, n_inputs, generator)
        return [w.to(self.device) for w in weights]

    def batch(self, rows: Tensor) -> Tensor:
        """(n_pairs, m, d) inputs of the samples `rows` (m,)."""
        x = self.inputs.index_select(1, rows)
        if self.encoder.sensor:
            parts = [with_frames(x[k], samples, rows) for k, samples in enumerate(self.data)]
            x = torch.stack(parts).to(self.device)
        return x.repeat_interleave(self.n_terms, 0)


class _Fit:
    """Weights of all pairs on their way, and the best that each pair had on held-out data."""

    def __init__(self, table: _Table, settings: RewardModelSettings, generator: torch.Generator) -> None:
        self.table, self.settings, self.generator = table, settings, generator
        self.log_sigma_min = math.log(settings.sigma_train)
        self.weights = table.initial_weights(generator)
        for w in self.weights:
            w.grad = torch.empty_like(w)
            w.requires_grad_(bool(table.encoder.sensor))  # convolutions are left to autograd
        self.best_weights = [w.detach().clone() for w in self.weights]
        self.best_loss = torch.full((table.n_pairs,), math.inf, device=table.device)
        self.optimizer = torch.optim.Adam(self.weights, settings.learning_rate, fused=True)
        order = torch.randperm(table.n_samples, generator=generator)
        n_held_out = round(HELD_OUT * len(order)) if settings.patience else 0
        self.held_out, self.train = order[:n_held_out], order[n_held_out:]
        self.space: dict[int, list[Tensor]] = {}  # by batch size

    def epoch(self) -> None:
        """One pass through the training data in a new order."""
        shuffled = self.train[torch.randperm(len(self.train), generator=self.generator)]
        for rows in torch.split(shuffled, self.settings.batch_size):
            self._set_gradients(rows)
            self.optimizer.step()

    def _set_gradients(self, rows: Tensor) -> None:
        if self.table.encoder.sensor:
            gradients = torch.autograd.grad(self._loss(rows).sum(), self.weights)
            for w, gradient in zip(self.weights, gradients, strict=True):
                w.grad = gradient
            return
        if len(rows) not in self.space:
            self.space[len(rows)] = working_space(self.table.n_pairs, len(rows))
        targets = self.table.targets.index_select(1, rows)
        set_gradients(self.weights, self.table.batch(rows), targets, self.log_sigma_min, self.space[len(rows)])

    def _loss(self, rows: Tensor) -> Tensor:
        out = forward(*self.table.encoder(self.weights, self.table.batch(rows)))
        return negative_log_likelihood(out, self.table.targets[:, rows], self.log_sigma_min)

    @torch.no_grad()
    def judge(self) -> bool:
        """Keep the weights of the pairs that are better than ever on held-out data; whether these are not a few."""
        parts = torch.split(self.held_out, FRAMES_AT_ONCE if self.table.encoder.sensor else len(self.held_out))
        now = torch.stack([self._loss(rows) * (len(rows) / len(self.held_out)) for rows in parts]).sum(0)
        better = now < self.best_loss
        self.best_loss = torch.where(better, now, self.best_loss)
        for kept, w in zip(self.best_weights, self.weights, strict=True):
            kept[better] = w[better]
        return bool(better.float().mean() > STILL_LEARNING)
