"""MLPs of one shape that run side by side, with their gradients written out.

Autograd records every operation and allocates every gradient, which at these sizes costs as much as the arithmetic; a
stack computes just the gradients that are asked for, into one block of memory. tests/core/networks/test_stacked.py
holds it against autograd.
"""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor

from causalbench.core.networks.state import State, load_tensors, tensor_state

Activation = Literal["relu", "tanh"]

ALIGNMENT = 16  # numbers; views start where tensors of their own would, since BLAS may round by where its inputs lie


class StackedMLP:
    """`count` MLPs; `weights` are [W1, b1, ...], W (count, n_in, n_out), b (count, n_out), views of the block `flat`.

    `gradients` are views of `flat.grad` in the same order, so that an optimiser has one tensor to go over. The last
    kernel lies transposed: a matrix product with few columns is several times slower than one with few rows.
    """

    def __init__(self, weights: list[Tensor], activation: Activation) -> None:
        self.activation = activation
        self.flat, self.weights = _packed(weights)
        self.flat.grad, self.gradients = _packed([torch.zeros_like(w) for w in weights])

    def forward(self, inputs: Tensor) -> list[Tensor]:
        """Inputs, hidden activations and outputs, each (count, batch, n); `inputs` (batch, n_inputs), for all."""
        layers = [inputs.expand(len(self.weights[0]), -1, -1)]
        for kernel, bias in zip(self.weights[:-2:2], self.weights[1:-2:2], strict=True):
            x = torch.baddbmm(bias.unsqueeze(1), layers[-1], kernel)
            layers.append(x.relu_() if self.activation == "relu" else x.tanh_())
        kernel, bias = self.weights[-2:]
        layers.append(torch.baddbmm(bias.unsqueeze(2), kernel.mT, layers[-1].mT).mT)
        return layers

    def backward(self, layers: list[Tensor], gradient: Tensor) -> Tensor:
        """Put into `gradients` those of an objective whose `gradient` by the outputs (count, batch, n) is given.

        `layers` are what `forward` gave. Gives the gradient by what the first kernel and bias yield.
        """
        for k in reversed(range(len(layers) - 1)):
            kernel_gradient, bias_gradient = self.gradients[2 * k : 2 * k + 2]
            torch.sum(gradient, 1, out=bias_gradient)
            if k == len(layers) - 2:
                torch.bmm(gradient.mT, layers[k], out=kernel_gradient.mT)
            else:
                torch.bmm(layers[k].mT, gradient, out=kernel_gradient)
            if k:
                gradient = self._through(_product(gradient, self.weights[2 * k].mT), layers[k])
        return gradient

    def input_gradient(self, layers: list[Tensor], net: int, rows: Tensor, outputs: Tensor, first: int) -> Tensor:
        """Gradient (n, n_inputs - first) of single outputs of MLP `net` by its inputs from `first` on.

        The i-th row belongs to output `outputs[i]` at batch row `rows[i]`; both (n,) int64.
        """
        gradient = self.weights[-2][net].T.index_select(0, outputs)
        for k in reversed(range(1, len(layers) - 1)):
            gradient = self._through(gradient, layers[k][net].index_select(0, rows))
            kernel = self.weights[2 * k - 2][net]
            gradient = torch.mm(gradient, (kernel if k > 1 else kernel[first:]).T)
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


def _product(a: Tensor, b: Tensor) -> Tensor:
    return a * b if a.shape[-1] == 1 else torch.bmm(a, b)  # an outer product is no matter for BLAS


def _packed(weights: list[Tensor]) -> tuple[Tensor, list[Tensor]]:
    """One block of memory, and views of it with the values of `weights`."""
    stored = [*weights[:-2], weights[-2].mT, weights[-1]]
    lengths = [-(-w.numel() // ALIGNMENT) * ALIGNMENT for w in stored]
    flat = torch.zeros(sum(lengths), dtype=weights[0].dtype)
    views = [part[: w.numel()].view(w.shape) for part, w in zip(torch.split(flat, lengths), stored, strict=True)]
    for view, w in zip(views, stored, strict=True):
        view.copy_(w)
    views[-2] = views[-2].mT
    return flat, views
