"""The learner's losses and gradients against stable-baselines3's SAC and against finite differences."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
import torch
from agents import MATRIX, plan
from stable_baselines3 import SAC
from stable_baselines3.common.logger import configure
from stable_baselines3.common.type_aliases import ReplayBufferSamples

from causalbench.core.learners.sac import fused, losses
from causalbench.core.learners.sac.agent import ENGINES as ENGINE
from causalbench.core.learners.sac.agent import SACAgent
from causalbench.core.learners.sac.buffer import Batch, StageBuffer
from causalbench.core.learners.sac.settings import PRESETS, SACSettings
from causalbench.errors import DivergedError

N_OBS, N_ACTIONS, BATCH = 5, 3, 32
SMALL = SACSettings(net_arch=(16, 16), batch_size=BATCH, learning_rate=3e-4)
ENGINES = pytest.mark.parametrize("engine", ["fused", "autograd"])


def _batch(n_critics: int, seed: int = 0) -> Batch:
    g = torch.Generator().manual_seed(seed)
    return Batch(
        torch.randn(BATCH, N_OBS, generator=g),
        torch.rand(BATCH, N_ACTIONS, generator=g) * 2 - 1,
        torch.randn(BATCH, n_critics, generator=g),
        torch.randn(BATCH, N_OBS, generator=g),
        (torch.rand(BATCH, generator=g) < 0.2).float(),
    )


class _Env(gym.Env):
    observation_space = gym.spaces.Box(-10, 10, (N_OBS,), np.float32)
    action_space = gym.spaces.Box(-1, 1, (N_ACTIONS,), np.float32)


def _linears(module: torch.nn.Module) -> list[torch.nn.Linear]:
    return [layer for layer in module.modules() if isinstance(layer, torch.nn.Linear)]


def _sb3_with_weights_of(agent: SACAgent, gradient_descent: bool) -> SAC:
    """An SB3 SAC that holds the agent's weights; with `gradient_descent` its optimisers do w <- w - gradient."""
    plain = {"optimizer_class": torch.optim.SGD} if gradient_descent else {}
    model = SAC(
        "MlpPolicy",
        _Env(),
        learning_rate=1.0 if gradient_descent else SMALL.learning_rate,
        batch_size=BATCH,
        ent_coef=f"auto_{SMALL.ent_coef_init}",
        policy_kwargs={"net_arch": list(SMALL.net_arch), **plain},
        device="cpu",
        seed=0,
    )
    model.set_logger(configure(None, []))
    with torch.no_grad():
        layers = _linears(model.actor.latent_pi)
        actor = agent.policy_weights
        for layer, w, b in zip(layers, actor[:-2:2], actor[1:-2:2], strict=True):
            layer.weight.copy_(w.T)
            layer.bias.copy_(b)
        for head, columns in ((model.actor.mu, slice(0, N_ACTIONS)), (model.actor.log_std, slice(N_ACTIONS, None))):
            head.weight.copy_(actor[-2][:, columns].T)
            head.bias.copy_(actor[-1][columns])
        for networks, weights in (
            (model.critic, agent.networks.critics.weights),
            (model.critic_target, agent.networks.targets.weights),
        ):
            for twin, network in enumerate((networks.qf0, networks.qf1)):
                for layer, w, b in zip(_linears(network), weights[::2], weights[1::2], strict=True):
                    layer.weight.copy_(w[twin].T)
                    layer.bias.copy_(b[twin])
    return model


def _sb3_weights(model: SAC) -> tuple[list[torch.Tensor], list[torch.Tensor], list[torch.Tensor]]:
    """Actor, critic and target weights in our layout."""
    actor = [t for layer in _linears(model.actor.latent_pi) for t in (layer.weight.T, layer.bias)]
    mu, log_std = model.actor.mu, model.actor.log_std
    actor += [torch.cat([mu.weight, log_std.weight]).T, torch.cat([mu.bias, log_std.bias])]

    def twins(networks):
        pairs = zip(_linears(networks.qf0), _linears(networks.qf1), strict=True)
        return [t for a, b in pairs for t in (torch.stack([a.weight.T, b.weight.T]), torch.stack([a.bias, b.bias]))]

    return actor, twins(model.critic), twins(model.critic_target)


@pytest.fixture
def same_noise(monkeypatch):
    """Both learners draw the same noise: first for the actions at s, then for those at s'; ours in one go."""
    noise = [torch.randn(BATCH, N_ACTIONS, generator=torch.Generator().manual_seed(s)) for s in (11, 12)]

    def start(agent: SACAgent) -> None:
        theirs = iter(noise * 3)
        monkeypatch.setattr(agent, "_noise", lambda shape: torch.cat(noise))
        monkeypatch.setattr(torch.distributions.normal, "_standard_normal", lambda *a, **k: next(theirs))

    return start


@ENGINES
@pytest.mark.parametrize("gradient_descent", [True, False], ids=["gradients", "adam"])
def test_one_critic_and_an_all_ones_matrix_is_sb3s_sac(engine, gradient_descent, same_noise, monkeypatch):
    """After SGD at rate 1 the weights differ from the start by exactly the gradients; after Adam by its step."""
    agent = SACAgent(plan(np.ones((N_ACTIONS, 1))), N_OBS, dataclasses.replace(SMALL, engine=engine), seed=3)
    model = _sb3_with_weights_of(agent, gradient_descent)
    if gradient_descent:
        agent.actor_optimizer = torch.optim.SGD([agent.networks.actor.flat, agent.networks.log_alpha], 1.0)
        agent.critic_optimizer = torch.optim.SGD([agent.networks.critics.flat], 1.0)
        model.ent_coef_optimizer = torch.optim.SGD([model.log_ent_coef], 1.0)
    batch = _batch(1)
    samples = ReplayBufferSamples(batch.obs, batch.actions, batch.next_obs, batch.done[:, None], batch.rewards)
    monkeypatch.setattr(model.replay_buffer, "sample", lambda *a, **k: samples)
    monkeypatch.setattr(agent.buffer, "sample", lambda *a, **k: batch)
    same_noise(agent)
    model._current_progress_remaining = 1.0
    if gradient_descent:
        monkeypatch.setattr(model, "_update_learning_rate", lambda optimizers: None)
    agent.train(1)
    model.train(gradient_steps=1, batch_size=BATCH)
    trained = (agent.policy_weights, agent.networks.critics.weights, agent.networks.targets.weights)
    for ours, theirs in zip(trained, _sb3_weights(model), strict=True):
        for w, expected in zip(ours, theirs, strict=True):
            torch.testing.assert_close(w, expected.detach(), atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(agent.networks.log_alpha, model.log_ent_coef.detach(), atol=1e-5, rtol=1e-5)


def _critics(agent: SACAgent, obs: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
    """(2, n_critics, batch) of both twins, net by net."""
    x = torch.cat([obs, action], 1)
    outputs = []
    for w1, b1, w2, b2, w3, b3 in zip(*agent.networks.critics.weights, strict=True):
        outputs.append((torch.relu(torch.relu(x @ w1 + b1) @ w2 + b2) @ w3 + b3).T)
    return torch.cat(outputs).view(2, -1, len(obs))


FORMS = pytest.mark.parametrize(
    ("critics", "joint_twin"), [("rows", False), ("heads", False), ("terms", True)], ids=["rows", "heads", "terms"]
)


def _factored(critics, joint_twin) -> SACAgent:
    masked = plan(MATRIX, joint_twin, entropy=[False, False, True])
    return SACAgent(masked, N_OBS, dataclasses.replace(SMALL, critics=critics), seed=1)


def _value_and_slope(engine, agent: SACAgent, obs, action) -> tuple[torch.Tensor, torch.Tensor]:
    """What the causal policy gradient climbs, and its gradient by the actions."""
    networks = agent.networks
    if engine == "fused":
        return fused.causal_value(networks, obs, action)
    action = action.clone().requires_grad_()
    value = losses.causal_value(networks.q, obs, action, networks.mask, networks.joint_twin)
    return value.detach(), torch.autograd.grad(value.sum(), action)[0]


@FORMS
@ENGINES
@pytest.mark.usefixtures("double_precision")
def test_factored_gradient_equals_finite_differences_of_the_masked_objective(engine, critics, joint_twin):
    """Gradient of sum_c Q_c(s, a with the dimensions that do not cause c frozen) by central differences in float64."""
    agent = _factored(critics, joint_twin)
    obs = _batch(3).obs
    frozen = torch.rand(BATCH, N_ACTIONS, generator=torch.Generator().manual_seed(4)) * 2 - 1
    matrix = torch.tensor(MATRIX)

    def objective(action):
        """Written out anew, loop by loop: what the causal policy gradient maximises."""
        twins = torch.zeros(2, 3, BATCH)
        for c in range(3):
            twins[:, c] = _critics(agent, obs, torch.where(matrix[:, c].bool(), action, frozen))[:, c]
        if joint_twin:
            return torch.minimum(twins[0].sum(0), twins[1].sum(0))
        return torch.minimum(twins[0], twins[1]).sum(0)

    value, gradient = _value_and_slope(engine, agent, obs, frozen)
    torch.testing.assert_close(value, objective(frozen))
    step = 1e-6
    for k in range(N_ACTIONS):
        bump = torch.zeros(N_ACTIONS)
        bump[k] = step
        numeric = (objective(frozen + bump) - objective(frozen - bump)) / (2 * step)
        torch.testing.assert_close(gradient[:, k], numeric, atol=1e-6, rtol=1e-5)


@FORMS
@ENGINES
def test_the_critics_learn_the_rewards_that_are_theirs(engine, critics, joint_twin):
    """Half the squared Bellman error, number by number: each critic has its reward, the entropy enters the last alone.

    The targets are still the critics.
    """
    agent, batch, gradients = _factored(critics, joint_twin), _batch(3), ENGINE[engine]
    alpha, noise = torch.tensor([0.3]), torch.randn(BATCH, N_ACTIONS, generator=torch.Generator().manual_seed(5))
    then = gradients.draw(agent.networks, batch.next_obs, noise)
    loss = gradients.critic_gradient(agent.networks, batch, then, alpha)
    now = _critics(agent, batch.obs, batch.actions).numpy()
    following = _critics(agent, batch.next_obs, then.action.detach()).numpy()
    log_prob, expected = then.log_prob.detach().numpy(), 0.0
    for n in range(BATCH):
        together = following[:, :, n].sum(1).argmin()
        for c in range(3):
            value = following[together, c, n] if joint_twin else following[:, c, n].min()
            bonus = 0.3 * log_prob[n] if c == 2 else 0.0
            target = batch.rewards[n, c].item() + 0.99 * (1 - batch.done[n].item()) * (value - bonus)
            expected += sum(0.5 * (now[twin, c, n] - target) ** 2 for twin in (0, 1)) / BATCH
    assert loss.item() == pytest.approx(expected, rel=1e-5)


@ENGINES
def test_an_action_that_causes_nothing_gets_no_gradient(engine):
    agent = SACAgent(plan([[1], [0], [1]]), N_OBS, SMALL, seed=1)
    gradient = _value_and_slope(engine, agent, _batch(1).obs, torch.zeros(BATCH, N_ACTIONS))[1]
    assert (gradient[:, 1] == 0).all()
    assert (gradient[:, [0, 2]] != 0).any(0).all()


def test_permuting_reward_terms_changes_nothing():
    """Critics, rewards and mask in another order: the same actor after the same updates."""
    order = [2, 0, 1]
    one = SACAgent(plan(MATRIX), N_OBS, SMALL, seed=1)
    two = SACAgent(plan(np.array(MATRIX)[:, order]), N_OBS, SMALL, seed=1)
    rows = torch.tensor([*order, *(3 + i for i in order)])
    for networks in (two.networks.critics, two.networks.targets):
        for w in networks.weights:
            w.copy_(w[rows].clone())
    batch = _batch(3)
    one.buffer.sample = lambda *a: batch
    two.buffer.sample = lambda *a: batch._replace(rewards=batch.rewards[:, order])
    one.train(5)
    two.train(5)
    for w, v in zip(one.policy_weights, two.policy_weights, strict=True):
        torch.testing.assert_close(w, v, atol=1e-6, rtol=1e-6)


@ENGINES
def test_cooperation_mixes_the_next_stages_critic(engine):
    """The gradient at the outputs of a policy without temperature, and the loss."""
    settings = dataclasses.replace(SMALL, cooperation_weight=0.3)
    agent, following = (SACAgent(plan(np.ones((N_ACTIONS, 1))), N_OBS, settings, seed=s) for s in (1, 2))
    obs, nothing, gradients = _batch(1).obs, torch.zeros(1), ENGINE[engine]
    noise = torch.randn(BATCH, N_ACTIONS, generator=torch.Generator().manual_seed(5))
    drawn = gradients.draw(agent.networks, obs, noise)
    action = drawn.action.detach()
    (own, own_slope), (other, other_slope) = (_value_and_slope(engine, a, obs, action) for a in (agent, following))
    own_scale = 0.99 + 0.01 * own.abs().mean()  # the running means start at 1
    other_scale = 0.99 + 0.01 * other.abs().mean()
    loss = gradients.actor_gradient(agent.networks, obs, drawn, nothing, following.networks)
    torch.testing.assert_close(loss, -(0.7 * own + 0.3 * other * own_scale / other_scale).mean())
    slope = 0.7 * own_slope + 0.3 * other_slope * own_scale / other_scale
    by_mean = -(slope * (1 - action**2)).mean(0)
    torch.testing.assert_close(agent.networks.actor.gradients[-1][0, :N_ACTIONS], by_mean)


@ENGINES
def test_temperature_aims_at_the_agents_own_number_of_actions(engine):
    for n in (1, 4):
        networks = SACAgent(plan(np.ones((n, 1))), N_OBS, SMALL, seed=1).networks
        for entropy, direction in ((-n - 0.5, 1), (-n + 0.5, -1)):  # too little entropy: alpha must rise
            ENGINE[engine].alpha_gradient(networks, torch.full((BATCH,), -float(entropy)))
            assert torch.sign(-networks.log_alpha.grad).item() == direction


@ENGINES
def test_a_loss_that_is_not_finite_ends_training(engine):
    agent = SACAgent(plan(np.ones((N_ACTIONS, 1))), N_OBS, dataclasses.replace(SMALL, engine=engine), seed=1)
    agent.buffer.sample = lambda *a: _batch(1)._replace(rewards=torch.full((BATCH, 1), float("nan")))
    with pytest.raises(DivergedError, match=r"not finite .* after 3 updates"):
        agent.train(3)


def test_buffer_is_first_in_first_out():
    buffer = StageBuffer(4, 1, 1, 1)
    for value in range(6):
        buffer.add(Batch(*(torch.full((1, 1), float(value)) for _ in range(4)), torch.zeros(1)))
    assert (buffer.size, buffer.position, buffer.new) == (4, 2, 6)
    assert sorted(buffer.data.obs[:, 0].tolist()) == [2, 3, 4, 5]
    drawn = buffer.sample(200, torch.Generator().manual_seed(0))
    assert set(drawn.obs[:, 0].tolist()) == {2, 3, 4, 5}


def test_paper_preset_has_the_papers_numbers():
    paper = PRESETS["paper"]
    assert (paper.gamma, paper.buffer_size, paper.train_every, paper.batch_size) == (0.99, 10_000, 1000, 512)
    assert (paper.learning_rate, paper.tau, paper.net_arch) == (5e-4, 0.005, (512, 512))
