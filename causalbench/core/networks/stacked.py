"""MLPs of one shape that run side by side, for autograd or with their gradients written out.

Autograd records every operation and allocates every gradient, which at these sizes costs as much as the arithmetic; a
stack computes just the gradients that are asked for, into one block of memory. tests/core/networks/test_stacked.py
holds them against autograd.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Literal, NamedTuple, Self

import torch
from torch import Tensor

from causalbench.core.networks.state import State, load_tensors, tensor_state

Activation = Literal["relu", "tanh"]

ALIGNMENT = 16  # numbers; views start where tensors of their own would, since BLAS may round by where its inputs lie


class Pass(NamedTuple):
    """A forward pass, with what the backward one needs of it."""

    observed: Tensor  # (batch, n_obs) as it came, before any encoder
    layers: list[Tensor]  # inputs of the first kernel, hidden activations, outputs: each (count, batch, n)

    @property
    def outputs(self) -> Tensor:
        """(count, batch, n_outputs)."""
        return self.layers[-1]

    def rows(self, rows: slice) -> Pass:
        """The same pass for some rows of the batch."""
        return Pass(self.observed[rows], [layer[:, rows] for layer in self.layers])


class StackedMLP:
    """`count` MLPs; `weights` are [W1, b1, ...], W (count, n_in, n_out), b (count, n_out), views of the block `flat`.

    `gradients` are views of `flat.grad` in the same order, so that an optimiser has one tensor to go over. The last
    kernel lies transposed: a matrix product with few columns is several times slower than one with few rows.
    """

    n_encoder = 0  # how many of `weights` come before the MLPs'

    def __init__(self, weights: Sequence[Tensor], activation: Activation) -> None:
        self.activation = activation
        self.flat, self.weights = _packed(weights)
        self.flat.grad, self.gradients = _packed([torch.zeros_like(w) for w in weights])

    def features(self, obs: Tensor) -> Tensor:
        """What the MLPs see of observations (batch, n_obs): here all of them, as they are."""
        return obs

    def forward(self, obs: Tensor, actions: Tensor | None = None) -> Pass:
        """The pass of all MLPs over the same inputs: `obs` (batch, n_obs), and beside them `actions` (batch, n)."""
        seen = self.features(obs)
        return Pass(obs, self.layers(seen if actions is None else torch.cat([seen, actions], 1)))

    def layers(self, inputs: Tensor) -> list[Tensor]:
        """Inputs, hidden activations and outputs of the MLPs, (count, batch, n) each.

        `inputs` (batch, n_in) are for all MLPs, (count, batch, n_in) one for each.
        """
        weights = self.weights[self.n_encoder :]
        layers = [inputs.expand(len(weights[0]), -1, -1)]
        for kernel, bias in zip(weights[:-2:2], weights[1:-2:2], strict=True):
            x = torch.baddbmm(bias.unsqueeze(1), layers[-1], kernel)
            layers.append(x.relu_() if self.activation == "relu" else x.tanh_())
        kernel, bias = weights[-2:]
        layers.append(torch.baddbmm(bias.unsqueeze(2), kernel.mT, layers[-1].mT).mT)
        return layers

    def recorded(self) -> Self:
        """The same networks in the same memory, but autograd records what they do."""
        twin = copy.copy(self)
        twin.weights = [w.detach().requires_grad_() for w in self.weights]
        return twin

    def backward(self, passed: Pass, by_outputs: Tensor) -> Tensor:
        """Write into `gradients` those of an objective whose gradient `by_outputs` (count, batch, n) is given.

        Returns the gradient by what the first kernel and bias yield.
        """
        gradient, layers = by_outputs, passed.layers
        weights, gradients = self.weights[self.n_encoder :], self.gradients[self.n_encoder :]
        for k in reversed(range(len(layers) - 1)):
            torch.sum(gradient, 1, out=gradients[2 * k + 1])
            if k == len(layers) - 2:
                torch.bmm(gradient.mT, layers[k], out=gradients[2 * k].mT)
            else:
                torch.bmm(layers[k].mT, gradient, out=gradients[2 * k])
            if k:
                gradient = self._through(_product(gradient, weights[2 * k].mT), layers[k])
        return gradient

    def action_gradient(self, passed: Pass, net: int, rows: Tensor, outputs: Tensor, n_actions: int) -> Tensor:
        """Gradient (n, n_actions) of single outputs of MLP `net` by its last `n_actions` inputs.

        The i-th row belongs to output `outputs[i]` at batch row `rows[i]`; both (n,) int64.
        """
        weights, layers = self.weights[self.n_encoder :], passed.layers
        gradient = weights[-2][net].T.index_select(0, outputs)
        for k in reversed(range(1, len(layers) - 1)):
            gradient = self._through(gradient, layers[k][net].index_select(0, rows))
            kernel = weights[2 * k - 2][net]
            gradient = torch.mm(gradient, (kernel if k > 1 else kernel[-n_actions:]).T)
        return gradient

    def state(self) -> State:
        """The weights."""
        return tensor_state(self.weights)

    def load_state(self, state: State) -> None:
        """Overwrite the weights in place."""
        load_tensors(self.weights, state)

    def _through(self, gradient: Tensor, activations: Tensor) -> Tensor:
        """Backwards through the activation function, in place."""
        aten = torch.ops.aten
        if self.activation == "relu":
            return aten.threshold_backward.grad_input(gradient, activations, 0, grad_input=gradient)
        return aten.tanh_backward.grad_input(gradient, activations, grad_input=gradient)


def differentiate(loss: Tensor, weights: Sequence[Tensor], gradients: Sequence[Tensor]) -> None:
    """Write autograd's gradients of `loss` by `weights`, which it recorded, into `gradients`, in the same order."""
    for gradient, found in zip(gradients, torch.autograd.grad(loss, weights), strict=True):
        gradient.copy_(found)


def mlp(weights: Sequence[Tensor], inputs: Tensor, activation: Activation) -> Tensor:
    """(batch, n_out) of a single MLP with `weights` [W1, b1, ...], W (n_in, n_out); `inputs` (batch, n_in).

    The last layer is rounded the same however its kernel lies in memory: a policy read from a file acts the same.
    """
    x = inputs
    for kernel, bias in zip(weights[:-2:2], weights[1:-2:2], strict=True):
        x = torch.addmm(bias, x, kernel)
        x = x.relu_() if activation == "relu" else x.tanh_()
    kernel, bias = weights[-2:]
    return torch.addmm(bias[:, None], kernel.T.contiguous(), x.T).T


def _product(a: Tensor, b: Tensor) -> Tensor:
    return a * b if a.shape[-1] == 1 else torch.bmm(a, b)  # an outer product is no matter for BLAS


def _packed(weights: Sequence[Tensor]) -> tuple[Tensor, list[Tensor]]:
    """One block of memory, and views of it with the values of `weights`."""
    stored = [*weights[:-2], weights[-2].mT, weights[-1]]
    lengths = [-(-w.numel() // ALIGNMENT) * ALIGNMENT for w in stored]
    flat = torch.zeros(sum(lengths), dtype=weights[0].dtype)
    views = [part[: w.numel()].view(w.shape) for part, w in zip(torch.split(flat, lengths), stored, strict=True)]
    for view, w in zip(views, stored, strict=True):
        view.copy_(w)
    views[-2] = views[-2].mT
    return flat, views
