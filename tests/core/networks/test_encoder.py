"""The paper's convolutions: shapes, a plain torch network as truth, and the printed list that cannot be built."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from torch import nn

from causalbench.core.networks import encoder
from causalbench.core.networks.encoder import SENSORS, Encoder


def reference(name: str) -> nn.Sequential:
    """As the appendix prints it, by torch's own modules."""
    if name == "lidar":
        layers = [nn.Conv1d(1, 32, 8, 4), nn.ReLU(), nn.Conv1d(32, 64, 4, 2), nn.ReLU(), nn.Conv1d(64, 64, 3, 1)]
        return nn.Sequential(*layers, nn.ReLU(), nn.Flatten())
    layers = [nn.Conv2d(3, 32, (6, 8), 4), nn.ReLU(), nn.Conv2d(32, 64, (3, 4), 2), nn.ReLU(), nn.MaxPool2d(2, 2)]
    return nn.Sequential(*layers, nn.Conv2d(64, 64, (2, 2), 2), nn.ReLU(), nn.Flatten())


def samples(name: str, *leading: int) -> torch.Tensor:
    return torch.rand(*leading, SENSORS[name].size, generator=torch.Generator().manual_seed(0)) * SENSORS[name].full


@pytest.mark.parametrize(("name", "features"), [("rgb", 64), ("lidar", 1536)])
def test_features_are_those_of_a_plain_network(name: str, features: int) -> None:
    network, sensor = reference(name), SENSORS[name]
    inputs = samples(name, 5)
    channels_first = (inputs / sensor.full).reshape(5, *sensor.shape).movedim(-1, 1)
    weights = [w.detach() for w in network.parameters()]
    ours = Encoder(name).encode(weights, inputs)
    assert ours.shape == (5, features)
    assert Encoder(name).n_features == features
    torch.testing.assert_close(ours, network(channels_first).detach())


@pytest.mark.parametrize("name", SENSORS)
def test_encoders_side_by_side_are_independent(name: str) -> None:
    one = Encoder(name)
    weights = one.initial_weights(torch.Generator().manual_seed(1), 3)
    inputs = samples(name, 3, 4)
    together = one.encode(weights, inputs)
    for i in range(3):
        torch.testing.assert_close(together[i], one.encode([w[i] for w in weights], inputs[i]))
    assert not torch.allclose(together[0], together[1])


@pytest.mark.parametrize("name", SENSORS)
def test_weights_begin_as_those_of_torch(name: str) -> None:
    """Uniform within the bound of `torch.nn.Conv`, layer by layer."""
    torch.manual_seed(0)
    for ours, theirs in zip(
        Encoder(name).initial_weights(torch.Generator().manual_seed(0)), reference(name).parameters(), strict=True
    ):
        assert ours.shape == theirs.shape
        assert float(ours.abs().max()) == pytest.approx(float(theirs.detach().abs().max()), rel=0.15)


def test_the_state_passes_unchanged_and_no_sensor_changes_nothing() -> None:
    rest, state, image = [torch.zeros(1)], torch.rand(2, 15), samples("rgb", 2)
    one = Encoder("rgb")
    following, seen = one([*one.initial_weights(torch.Generator()), *rest], torch.cat([state, image], 1))
    assert following == rest
    assert seen.shape == (2, 15 + 64)
    assert torch.equal(seen[:, :15], state)
    nothing = Encoder()
    assert nothing(rest, state) == (rest, state)
    assert (nothing.n_weights, nothing.n_features, nothing.n_sensed) == (0, 0, 0)


@pytest.mark.parametrize("turned", [False, True])
def test_the_printed_list_cannot_be_built(monkeypatch: pytest.MonkeyPatch, turned: bool) -> None:
    """Its third kernel is larger than what is left of the image, whichever way round sizes are read."""
    layers = encoder.PRINTED_RGB
    if turned:
        layers = tuple(
            dataclasses.replace(layer, kernel=layer.kernel[::-1]) if isinstance(layer, encoder.Conv) else layer
            for layer in layers
        )
    printed = dataclasses.replace(SENSORS["rgb"], layers=layers)
    monkeypatch.setattr(encoder, "SENSORS", {"rgb": printed})
    with pytest.raises(RuntimeError, match="Kernel size can't be greater than actual input size"):
        _ = Encoder("rgb").n_features
