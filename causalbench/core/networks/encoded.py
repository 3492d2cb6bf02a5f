"""MLPs that run side by side behind one encoder of the paper's, with the interface of `StackedMLP`."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from causalbench.core.networks.encoder import Encoder, device_for
from causalbench.core.networks.stacked import Activation, Pass, StackedMLP


class EncodedMLP(StackedMLP):
    """A `StackedMLP` whose `weights` begin with the encoder's, which have a leading dimension 1.

    The last numbers of an observation are what the sensor says; its features take their place. The convolutions run
    on a graphics card if torch sees one, and their gradients are always autograd's.
    """

    def __init__(self, encoder: Encoder, weights: Sequence[Tensor], activation: Activation) -> None:
        super().__init__(weights, activation)
        self.encoder, self.device, self.n_encoder = encoder, device_for(encoder.name), encoder.n_weights
        self._n_features = encoder.n_features

    def features(self, obs: Tensor) -> Tensor:
        """(batch, n_state + n_features) of observations (batch, n_state + n_sensed)."""
        state, sensed = self._split(obs)
        return torch.cat([state, self._encode(self._kernels(), sensed).cpu()], 1)

    def backward(self, passed: Pass, by_outputs: Tensor) -> Tensor:
        """As `StackedMLP.backward`, and through the encoder."""
        by_first = super().backward(passed, by_outputs)
        state, sensed = self._split(passed.observed)
        features = slice(state.shape[1], state.shape[1] + self._n_features)
        by_features = torch.bmm(by_first, self.weights[self.n_encoder][:, features].mT).sum(0)
        kernels = [w.clone().requires_grad_() for w in self._kernels()]
        found = torch.autograd.grad(self._encode(kernels, sensed), kernels, by_features.to(self.device))
        for own, by_weight in zip(self.gradients, found, strict=False):
            own[0] = by_weight
        return by_first

    def _kernels(self) -> list[Tensor]:
        return [w[0] for w in self.weights[: self.n_encoder]]

    def _split(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """State and sensed part of observations."""
        n_state = obs.shape[1] - self.encoder.n_sensed
        return obs[:, :n_state], obs[:, n_state:]

    def _encode(self, kernels: list[Tensor], sensed: Tensor) -> Tensor:
        return self.encoder.encode([w.to(self.device) for w in kernels], sensed.to(self.device))


def network(encoder: Encoder, weights: Sequence[Tensor], activation: Activation) -> StackedMLP:
    """MLPs with `weights`, which begin with those of `encoder` if it has any."""
    return EncodedMLP(encoder, weights, activation) if encoder.sensor else StackedMLP(weights, activation)
