"""MLPs that run side by side behind one encoder of the paper's, with the interface of `StackedMLP`."""

from __future__ import annotations

import torch
from torch import Tensor

from causalbench.core.networks.encoder import Encoder, device_for
from causalbench.core.networks.stacked import Activation, StackedMLP
from causalbench.core.networks.state import State, load_tensors, tensor_state


class SeeingMLP:
    """See `StackedMLP`; `weights` begin with the encoder's, with a leading dimension 1.

    Inputs (batch, n_obs + more) hold what the sensor says in the columns before `n_obs`. `forward` gives them as a
    first layer, so that `backward` can leave the convolutions to autograd. Those run on a graphics card if torch sees
    one.
    """

    def __init__(self, encoder: Encoder, weights: list[Tensor], n_obs: int, activation: Activation) -> None:
        self.encoder, self.device = encoder, device_for(encoder.name)
        self._first, self._last = n_obs - encoder.n_sensed, n_obs
        self._mlp, n = StackedMLP(weights, activation), encoder.n_weights
        self.flat, self.weights, self.gradients = self._mlp.flat, self._mlp.weights, self._mlp.gradients
        self._mlp.weights, self._mlp.gradients = self.weights[n:], self.gradients[n:]

    def forward(self, inputs: Tensor) -> list[Tensor]:
        """The inputs, and then as `StackedMLP.forward`."""
        features = self._encode([w[0] for w in self.weights[: self.encoder.n_weights]], inputs).cpu()
        seen = torch.cat([inputs[:, : self._first], features, inputs[:, self._last :]], 1)
        layers = self._mlp.forward(seen)
        return [inputs.expand(len(layers[0]), -1, -1), *layers]

    def _encode(self, weights: list[Tensor], inputs: Tensor) -> Tensor:
        sensed = inputs[:, self._first : self._last].to(self.device)
        return self.encoder.encode([w.to(self.device) for w in weights], sensed)

    def backward(self, layers: list[Tensor], gradient: Tensor) -> None:
        """As `StackedMLP.backward`, and through the encoder."""
        by_first = self._mlp.backward(layers[1:], gradient)
        features = slice(self._first, self._first + self.encoder.n_features)
        by_features = torch.bmm(by_first, self._mlp.weights[0][:, features].mT).sum(0)
        kernels = [w[0].detach().clone().requires_grad_() for w in self.weights[: self.encoder.n_weights]]
        found = torch.autograd.grad(self._encode(kernels, layers[0][0]), kernels, by_features.to(self.device))
        for own, by_weight in zip(self.gradients, found, strict=False):
            own[0] = by_weight

    def input_gradient(self, layers: list[Tensor], net: int, rows: Tensor, outputs: Tensor, first: int) -> Tensor:
        """As `StackedMLP.input_gradient`; `first` counts the inputs of `forward`."""
        behind = first - self.encoder.n_sensed + self.encoder.n_features
        return self._mlp.input_gradient(layers[1:], net, rows, outputs, behind)

    def state(self) -> State:
        """The weights."""
        return tensor_state(self.weights)

    def load_state(self, state: State) -> None:
        """Overwrite the weights in place."""
        load_tensors(self.weights, state)


Network = StackedMLP | SeeingMLP


def network(encoder: Encoder, weights: list[Tensor], n_obs: int, activation: Activation) -> Network:
    """MLPs with `weights`, which begin with those of `encoder` if it has any."""
    return SeeingMLP(encoder, weights, n_obs, activation) if encoder.sensor else StackedMLP(weights, activation)
