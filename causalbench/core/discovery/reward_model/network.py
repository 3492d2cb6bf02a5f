"""The network of the reward models: all pairs' weights side by side, its loss, and the loss's gradient written out.

Hidden layers F(128)-F(128)-F(128), outputs mean and log sigma (paper, appendix). Every tensor has the pairs first.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from causalbench.core.networks.init import uniform_mlp

HIDDEN = (128, 128, 128)
LOG_SIGMA_MAX = 4.0


def initial_weights(pairs: int, n_inputs: int, generator: torch.Generator) -> list[Tensor]:
    """Kernels (pairs, fan in, fan out) and biases (pairs, 1, fan out) of every layer, in order."""
    weights = uniform_mlp(pairs, (n_inputs, *HIDDEN, 2), generator)
    return [w if w.dim() == 3 else w.unsqueeze(1) for w in weights]


def forward(weights: list[Tensor], x: Tensor) -> Tensor:
    """(pairs, n, 2) means and log sigmas from inputs (pairs, n, d)."""
    for kernel, bias in zip(weights[:-2:2], weights[1:-2:2], strict=True):
        x = torch.baddbmm(bias, x, kernel).relu()
    return torch.baddbmm(weights[-1], x, weights[-2])


def negative_log_likelihood(out: Tensor, target: Tensor, log_sigma_min: float) -> Tensor:
    """(pairs,) mean negative log likelihood of `target` (pairs, n, 1), up to a constant."""
    log_sigma = out[..., 1:].clamp(log_sigma_min, LOG_SIGMA_MAX)
    return (0.5 * ((target - out[..., :1]) / log_sigma.exp()) ** 2 + log_sigma).mean((1, 2))


def working_space(pairs: int, n: int) -> list[Tensor]:
    """Two tensors (pairs, n, width) of every hidden layer, for `set_gradients`."""
    return [torch.empty(pairs, n, width) for width in HIDDEN * 2]


@torch.no_grad()
def set_gradients(
    weights: list[Tensor], x: Tensor, target: Tensor, log_sigma_min: float, space: Sequence[Tensor]
) -> None:
    """Set the gradient of the summed loss of a batch (pairs, n, d) in every weight, working in `space`.

    Backpropagation written out: autograd does the same products, to the bit, but takes new memory for each, and memory
    is what this waits for.
    """
    layers = [x]
    for kernel, bias, out in zip(weights[:-2:2], weights[1:-2:2], space[: len(HIDDEN)], strict=True):
        layers.append(torch.baddbmm(bias, layers[-1], kernel, out=out).relu_())
    prediction = torch.baddbmm(weights[-1], layers[-1], weights[-2]).requires_grad_()
    with torch.enable_grad():
        loss = negative_log_likelihood(prediction, target, log_sigma_min).sum()
    (gradient,) = torch.autograd.grad(loss, prediction)
    for i in reversed(range(len(layers))):
        torch.bmm(layers[i].mT, gradient, out=weights[2 * i].grad)
        torch.sum(gradient, 1, keepdim=True, out=weights[2 * i + 1].grad)
        if i:
            gradient = torch.bmm(gradient, weights[2 * i].mT, out=space[len(HIDDEN) + i - 1])
            torch.ops.aten.threshold_backward.grad_input(gradient, layers[i], 0, grad_input=gradient)
