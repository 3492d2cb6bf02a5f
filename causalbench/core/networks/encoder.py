"""The paper's networks in front of its networks: images and LiDAR scans to features (appendix, Network Architecture).

`observation: paper` puts one before every actor, every set of critics and every reward model. Many can run side by
side: weights and inputs then have a leading dimension, as everywhere in this project.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor
from torch.nn import functional

from causalbench.core.networks.init import uniform_layer


@dataclass(frozen=True)
class Conv:
    """The paper's C1(n, k, s) or C2(n, k, s). `kernel` is (height, width) or (length,)."""

    n: int
    kernel: tuple[int, ...]
    stride: int


@dataclass(frozen=True)
class Pool:
    """The paper's Pool(k, s) over squares."""

    size: int
    stride: int


@dataclass(frozen=True)
class Sensor:
    """What one sample of a sensor looks like and the layers that read it; ReLU after each convolution, flat at the end.

    `shape` is that of an observation, channels last; `full` is the value that becomes 1.
    """

    shape: tuple[int, ...]
    full: float
    dtype: torch.dtype
    layers: tuple[Conv | Pool, ...]

    @property
    def size(self) -> int:
        """Numbers in a sample."""
        return math.prod(self.shape)


PRINTED_RGB = (Conv(32, (6, 8), 4), Conv(64, (3, 4), 2), Conv(32, (6, 8), 4), Pool(2, 2), Conv(64, (2, 2), 2))
"""The paper's list, its kernels (8, 6) meaning width x height as its 64 x 48 does. The third layer meets 5 x 6 numbers
and cannot be built, the other way round neither."""

SENSORS: Mapping[str, Sensor] = {
    # Without the third layer, a repetition of the first: 64 features.
    "rgb": Sensor((48, 64, 3), 255.0, torch.uint8, PRINTED_RGB[:2] + PRINTED_RGB[3:]),
    # 1,536 features.
    "lidar": Sensor((220, 1), 10.0, torch.float32, (Conv(32, (8,), 4), Conv(64, (4,), 2), Conv(64, (3,), 1))),
}


def device_for(name: str) -> torch.device:
    """Where networks with the sensor `name` are trained: convolutions on a graphics card if torch sees one."""
    return torch.device("cuda" if name and torch.cuda.is_available() else "cpu")


@dataclass(frozen=True)
class Encoder:
    """Splits flat network inputs (..., n_state + sensor.size) and puts features in the sensor's place.

    The name "" stands for no sensor: then inputs pass unchanged and there are no weights.
    """

    name: str = ""

    @property
    def sensor(self) -> Sensor | None:
        """What the name stands for."""
        return SENSORS[self.name] if self.name else None

    @property
    def n_sensed(self) -> int:
        """How many of the inputs are the sensor's, the last ones."""
        return self.sensor.size if self.sensor else 0

    @property
    def n_weights(self) -> int:
        """How many tensors a list of weights begins with."""
        return 2 * len(self._convolutions) if self.sensor else 0

    @property
    def n_features(self) -> int:
        """How many numbers take the sensor's place."""
        if self.sensor is None:
            return 0
        sample = torch.zeros(1, self.sensor.size)
        return self.encode(self.initial_weights(torch.Generator()), sample).shape[-1]

    def n_seen(self, n_inputs: int) -> int:
        """How many numbers take the place of `n_inputs`."""
        return n_inputs - self.n_sensed + self.n_features

    @property
    def _convolutions(self) -> list[Conv]:
        return [layer for layer in self.sensor.layers if isinstance(layer, Conv)] if self.sensor else []

    def initial_weights(self, generator: torch.Generator, count: int = 0) -> list[Tensor]:
        """Kernels and biases of torch's own initialisation; with a leading dimension if `count` is not 0."""
        leading, weights = ((count,) if count else ()), list[Tensor]()
        if self.sensor is None:
            return weights
        channels = (self.sensor.shape[-1], *(layer.n for layer in self._convolutions))
        for layer, (before, after) in zip(self._convolutions, pairwise(channels), strict=True):
            kernel, bias = (*leading, after, before, *layer.kernel), (*leading, after)
            weights += uniform_layer(kernel, bias, before * math.prod(layer.kernel), generator)
        return weights

    def __call__(self, weights: list[Tensor], inputs: Tensor) -> tuple[list[Tensor], Tensor]:
        """The weights of what follows, and what it sees: (..., n_state + n_features).

        `weights` begin with the encoder's; `inputs` (n, n_inputs), or (count, n, n_inputs) for `count` encoders.
        """
        if self.sensor is None:
            return weights, inputs
        features = self.encode(weights[: self.n_weights], inputs[..., -self.sensor.size :])
        return weights[self.n_weights :], torch.cat([inputs[..., : -self.sensor.size], features], -1)

    def encode(self, weights: list[Tensor], sensed: Tensor) -> Tensor:
        """Features (n, n_features) of samples (n, size), or (count, n, ...) of `count` encoders, one each."""
        assert self.sensor is not None
        if sensed.dim() == 2:
            return self.encode([w.unsqueeze(0) for w in weights], sensed.unsqueeze(0)).squeeze(0)
        count, n = sensed.shape[:2]
        convolve = functional.conv2d if len(self.sensor.shape) == 3 else functional.conv1d
        # Groups are independent networks: (n, count * channels, ...).
        x = (sensed / self.sensor.full).reshape(count, n, *self.sensor.shape).movedim(-1, 2)
        x = x.transpose(0, 1).flatten(1, 2)
        pairs = iter(zip(weights[::2], weights[1::2], strict=True))
        for layer in self.sensor.layers:
            if isinstance(layer, Pool):
                x = functional.max_pool2d(x, layer.size, layer.stride)
            else:
                kernel, bias = next(pairs)
                x = convolve(x, kernel.flatten(0, 1), bias.flatten(), layer.stride, groups=count).relu()
        return x.reshape(n, count, -1).transpose(0, 1)
