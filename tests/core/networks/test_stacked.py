"""Networks side by side and their written-out gradients, against torch.nn.Linear layers and autograd."""

import pytest
import torch

from causalbench.core.networks.init import uniform_mlp
from causalbench.core.networks.stacked import StackedMLP

COUNT, N_IN, N_OUT, BATCH = 3, 5, 2, 16


def _stack(arch, activation) -> StackedMLP:
    generator = torch.Generator().manual_seed(0)
    weights = uniform_mlp(COUNT, (N_IN, *arch, N_OUT), generator)
    return StackedMLP([w.double() for w in weights], activation)


def _module(stack: StackedMLP, net: int) -> torch.nn.Sequential:
    layers: list[torch.nn.Module] = []
    for kernel, bias in zip(stack.weights[::2], stack.weights[1::2], strict=True):
        linear = torch.nn.Linear(*kernel.shape[1:], dtype=torch.float64)
        with torch.no_grad():
            linear.weight.copy_(kernel[net].T)
            linear.bias.copy_(bias[net])
        layers += [linear, torch.nn.ReLU() if stack.activation == "relu" else torch.nn.Tanh()]
    return torch.nn.Sequential(*layers[:-1])


@pytest.mark.parametrize("activation", ["relu", "tanh"])
@pytest.mark.parametrize("arch", [(7,), (8, 6), (8, 6, 4)])
def test_values_and_gradients_are_those_of_autograd(arch, activation):
    stack = _stack(arch, activation)
    g = torch.Generator().manual_seed(1)
    inputs = torch.randn(BATCH, N_IN, generator=g, dtype=torch.float64)
    slope = torch.randn(COUNT, BATCH, N_OUT, generator=g, dtype=torch.float64)  # of the objective by the outputs
    passed = stack.forward(inputs)
    stack.backward(passed, slope)
    assert stack.flat.grad is not None
    for net in range(COUNT):
        module = _module(stack, net)
        x = inputs.clone().requires_grad_()
        outputs = module(x)
        torch.testing.assert_close(passed.outputs[net], outputs.detach())
        parameters = torch.autograd.grad((outputs * slope[net]).sum(), list(module.parameters()), retain_graph=True)
        for ours, theirs in zip(stack.gradients, parameters, strict=True):
            torch.testing.assert_close(ours[net] if theirs.dim() == 1 else ours[net].T, theirs, atol=1e-9, rtol=1e-6)
        rows, heads = torch.tensor([3, 0, 3, 9]), torch.tensor([1, 0, 0, 1])
        by_input = stack.action_gradient(passed, net, rows, heads, N_IN - 2)
        for i, (row, head) in enumerate(zip(rows, heads, strict=True)):
            expected = torch.autograd.grad(outputs[row, head], x, retain_graph=True)[0][row, 2:]
            torch.testing.assert_close(by_input[i], expected, atol=1e-9, rtol=1e-6)


def test_an_optimiser_steps_all_weights_at_once():
    stack = _stack((4,), "relu")
    before = [w.clone() for w in stack.weights]
    stack.backward(
        stack.forward(torch.ones(BATCH, N_IN, dtype=torch.float64)), torch.ones(COUNT, BATCH, N_OUT).double()
    )
    torch.optim.SGD([stack.flat], 1.0).step()
    for w, old, gradient in zip(stack.weights, before, stack.gradients, strict=True):
        torch.testing.assert_close(w, old - gradient)


def test_a_saved_state_is_read_back_in_place():
    one, two = (_stack((4,), "relu") for _ in range(2))
    with torch.no_grad():
        two.flat.zero_()
    kept = two.weights[-2]
    two.load_state({name: w.clone() for name, w in one.state().items()})
    torch.testing.assert_close(two.flat, one.flat)
    torch.testing.assert_close(kept, one.weights[-2])
