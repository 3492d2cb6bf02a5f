"""Networks behind an encoder against autograd."""

from __future__ import annotations

import pytest
import torch

from causalbench.core.networks.encoded import EncodedMLP
from causalbench.core.networks.encoder import SENSORS, Encoder
from causalbench.core.networks.init import uniform_mlp

COUNT, N_STATE, N_ACTIONS, BATCH, OUTPUTS = 3, 4, 2, 5, 2


def _by_autograd(weights: list[torch.Tensor], one: Encoder, inputs: torch.Tensor, n_obs: int) -> torch.Tensor:
    """(COUNT, BATCH, OUTPUTS) of tanh networks that share the encoder."""
    n = one.n_weights
    features = one.encode([w[0] for w in weights[:n]], inputs[:, N_STATE:n_obs])
    x = torch.cat([inputs[:, :N_STATE], features, inputs[:, n_obs:]], 1).expand(COUNT, -1, -1)
    for kernel, bias in zip(weights[n:-2:2], weights[n + 1 : -2 : 2], strict=True):
        x = torch.baddbmm(bias.unsqueeze(1), x, kernel).tanh()
    return torch.baddbmm(weights[-1].unsqueeze(1), x, weights[-2])


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("arch", [(8,), (8, 6)])
def test_outputs_and_all_gradients_are_those_of_autograd(name: str, arch: tuple[int, ...]) -> None:
    g, one = torch.Generator().manual_seed(0), Encoder(name)
    n_obs = N_STATE + one.n_sensed
    weights = one.initial_weights(g, 1)
    weights += uniform_mlp(COUNT, (one.n_seen(n_obs) + N_ACTIONS, *arch, OUTPUTS), g)
    network = EncodedMLP(one, weights, "tanh")
    sensed = torch.rand(BATCH, one.n_sensed, generator=g) * SENSORS[name].full
    state, actions = torch.randn(BATCH, N_STATE, generator=g), torch.randn(BATCH, N_ACTIONS, generator=g)
    inputs = torch.cat([state, sensed, actions], 1).requires_grad_()
    leaves = [w.clone().requires_grad_() for w in weights]
    expected = _by_autograd(leaves, one, inputs, n_obs)
    obs = torch.cat([state, sensed], 1)
    passed = network.forward(obs, actions)
    torch.testing.assert_close(passed.outputs, expected.detach())

    by_outputs = torch.randn(COUNT, BATCH, OUTPUTS, generator=g)
    network.backward(passed, by_outputs)
    for ours, theirs in zip(network.gradients, torch.autograd.grad(expected, leaves, by_outputs, True), strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=1e-4)
    rows, outputs = torch.tensor([0, 3, 4]), torch.tensor([1, 0, 1])
    slope = network.action_gradient(passed, 2, rows, outputs, N_ACTIONS)
    (by_inputs,) = torch.autograd.grad(expected[2, rows, outputs].sum(), inputs)
    torch.testing.assert_close(slope, by_inputs[rows, n_obs:], atol=1e-6, rtol=1e-4)


def test_one_block_holds_everything() -> None:
    """What the optimiser goes over is what `forward` uses and what a checkpoint keeps."""
    g, one = torch.Generator().manual_seed(0), Encoder("lidar")
    n_obs = N_STATE + one.n_sensed
    weights = [*one.initial_weights(g, 1), *uniform_mlp(1, (one.n_seen(n_obs), 8, 1), g)]
    network, other = (EncodedMLP(one, weights, "relu") for _ in range(2))
    inputs = torch.rand(2, n_obs, generator=g)
    before = network.forward(inputs).outputs.clone()
    network.flat += 0.01
    assert not torch.allclose(network.forward(inputs).outputs, before)
    other.load_state(network.state())
    assert torch.equal(other.forward(inputs).outputs, network.forward(inputs).outputs)
