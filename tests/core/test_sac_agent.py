"""The learner's losses and gradients against stable-baselines3's SAC and against finite differences."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.logger import configure
from stable_baselines3.common.type_aliases import ReplayBufferSamples

from causalbench.core.discovery.graph import manual_graph
from causalbench.core.learners.causal_gradient import StagePlan, stage_plan, training_matrix
from causalbench.core.learners.methods import METHODS, PAPER
from causalbench.core.learners.replay import Batch, StageBuffer
from causalbench.core.learners.sac_agent import SACAgent
from causalbench.core.learners.settings import PRESETS, SACSettings
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.errors import DivergedError

N_OBS, N_ACTIONS, BATCH = 5, 3, 32
SMALL = SACSettings(net_arch=(16, 16), batch_size=BATCH, learning_rate=3e-4)
METHOD = {method.name: method for method in METHODS}


def _plan(mask, joint_twin=False, entropy=None) -> StagePlan:
    mask = np.array(mask, dtype=bool)
    n_critics = mask.shape[1]
    entropy = np.ones(n_critics, dtype=bool) if entropy is None else np.array(entropy)
    return StagePlan(np.arange(len(mask)), np.eye(n_critics, dtype=bool), mask, entropy, joint_twin)


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
        for layer, w, b in zip(layers, agent.actor[:-2:2], agent.actor[1:-2:2], strict=True):
            layer.weight.copy_(w.T)
            layer.bias.copy_(b)
        for head, columns in ((model.actor.mu, slice(0, N_ACTIONS)), (model.actor.log_std, slice(N_ACTIONS, None))):
            head.weight.copy_(agent.actor[-2][:, columns].T)
            head.bias.copy_(agent.actor[-1][columns])
        for networks, weights in ((model.critic, agent.critics), (model.critic_target, agent.targets)):
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
    """Both learners draw the same noise: first for the actions at s, then for those at s'."""
    noise = [torch.randn(BATCH, N_ACTIONS, generator=torch.Generator().manual_seed(s)) for s in (11, 12)]

    def start(agent: SACAgent) -> None:
        ours, theirs = iter(noise * 3), iter(noise * 3)
        monkeypatch.setattr(agent, "_noise", lambda shape: next(ours))
        monkeypatch.setattr(torch.distributions.normal, "_standard_normal", lambda *a, **k: next(theirs))

    return start


@pytest.mark.parametrize("gradient_descent", [True, False], ids=["gradients", "adam"])
def test_one_critic_and_an_all_ones_matrix_is_sb3s_sac(gradient_descent, same_noise, monkeypatch):
    """After SGD at rate 1 the weights differ from the start by exactly the gradients; after Adam by its step."""
    agent = SACAgent(_plan(np.ones((N_ACTIONS, 1))), N_OBS, SMALL, seed=3)
    model = _sb3_with_weights_of(agent, gradient_descent)
    if gradient_descent:
        agent.actor_optimizer = torch.optim.SGD(agent.actor, 1.0)
        agent.critic_optimizer = torch.optim.SGD(agent.critics, 1.0)
        agent.alpha_optimizer = torch.optim.SGD([agent.log_alpha], 1.0)
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
    for ours, theirs in zip((agent.actor, agent.critics, agent.targets), _sb3_weights(model), strict=True):
        for w, expected in zip(ours, theirs, strict=True):
            torch.testing.assert_close(w.detach(), expected.detach(), atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(agent.log_alpha.detach(), model.log_ent_coef.detach(), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("joint_twin", [False, True], ids=["rows", "terms"])
def test_factored_gradient_equals_finite_differences_of_the_masked_objective(joint_twin):
    """Gradient of sum_c Q_c(s, a with the dimensions that do not cause c frozen) by central differences in float64."""
    mask = [[1, 0, 1], [0, 1, 1], [1, 1, 0]]
    agent = SACAgent(_plan(mask, joint_twin, entropy=[False, False, True]), N_OBS, SMALL, seed=1)
    for weights in (agent.actor, agent.critics):
        for i, w in enumerate(weights):
            weights[i] = w.detach().double().requires_grad_()
    agent.mask = agent.mask.double()
    obs = _batch(3).obs.double()
    frozen = torch.rand(BATCH, N_ACTIONS, generator=torch.Generator().manual_seed(4)).double() * 2 - 1
    matrix = torch.tensor(mask).double()

    def objective(action):
        """Written out anew, loop by loop: what the causal policy gradient maximises."""
        from causalbench.core.learners.networks import critics_forward

        twins = torch.zeros(2, 3, BATCH, dtype=torch.float64)
        for c in range(3):
            seen = torch.where(matrix[:, c].bool(), action, frozen)
            q = critics_forward(agent.critics, torch.cat([obs, seen], 1))
            twins[0, c], twins[1, c] = q[c], q[3 + c]
        if joint_twin:
            return torch.minimum(twins[0].sum(0), twins[1].sum(0))
        return torch.minimum(twins[0], twins[1]).sum(0)

    action = frozen.clone().requires_grad_()
    gradient = torch.autograd.grad(agent.masked_value(obs, action).sum(), action)[0]
    step = 1e-6
    with torch.no_grad():
        for k in range(N_ACTIONS):
            bump = torch.zeros(N_ACTIONS, dtype=torch.float64)
            bump[k] = step
            numeric = (objective(frozen + bump) - objective(frozen - bump)) / (2 * step)
            torch.testing.assert_close(gradient[:, k], numeric, atol=1e-6, rtol=1e-5)


def test_an_action_that_causes_nothing_gets_no_gradient():
    agent = SACAgent(_plan([[1], [0], [1]]), N_OBS, SMALL, seed=1)
    action = torch.zeros(BATCH, N_ACTIONS, requires_grad=True)
    gradient = torch.autograd.grad(agent.masked_value(_batch(1).obs, action).sum(), action)[0]
    assert (gradient[:, 1] == 0).all()
    assert (gradient[:, [0, 2]] != 0).any(0).all()


def test_permuting_reward_terms_changes_nothing():
    """Critics, rewards and mask in another order: the same actor after the same updates."""
    order = [2, 0, 1]
    mask = np.array([[1, 0, 1], [0, 1, 1], [1, 1, 0]])
    one = SACAgent(_plan(mask), N_OBS, SMALL, seed=1)
    two = SACAgent(_plan(mask[:, order]), N_OBS, SMALL, seed=1)
    rows = torch.tensor([*order, *(3 + i for i in order)])
    with torch.no_grad():
        for weights in (two.critics, two.targets):
            for w in weights:
                w.copy_(w[rows].clone())
    batch = _batch(3)
    one.buffer.sample = lambda *a: batch
    two.buffer.sample = lambda *a: batch._replace(rewards=batch.rewards[:, order])
    one.train(5)
    two.train(5)
    for w, v in zip(one.actor, two.actor, strict=True):
        torch.testing.assert_close(w, v, atol=1e-6, rtol=1e-6)


def test_cooperation_mixes_the_next_stages_critic():
    settings = dataclasses.replace(SMALL, cooperation_weight=0.3)
    agent, following = (SACAgent(_plan(np.ones((N_ACTIONS, 1))), N_OBS, settings, seed=s) for s in (1, 2))
    obs = _batch(1).obs
    action = torch.zeros(BATCH, N_ACTIONS)
    alpha, log_prob = torch.tensor([0.0]), torch.zeros(BATCH)
    own, other = agent.masked_value(obs, action), following.masked_value(obs, action)
    own_scale = 0.99 + 0.01 * own.abs().mean()  # the running means start at 1
    other_scale = 0.99 + 0.01 * other.abs().mean()
    expected = -(0.7 * own + 0.3 * other * own_scale / other_scale).mean()
    torch.testing.assert_close(agent.actor_loss(obs, action, log_prob, alpha, following), expected)


def test_temperature_aims_at_the_agents_own_number_of_actions():
    for n in (1, 4):
        agent = SACAgent(_plan(np.ones((n, 1))), N_OBS, SMALL, seed=1)
        for entropy, direction in ((-n - 0.5, 1), (-n + 0.5, -1)):  # too little entropy: alpha must rise
            gradient = torch.autograd.grad(agent.alpha_loss(torch.full((BATCH,), -float(entropy))), agent.log_alpha)[0]
            assert torch.sign(-gradient).item() == direction


def test_a_loss_that_is_not_finite_ends_training():
    agent = SACAgent(_plan(np.ones((N_ACTIONS, 1))), N_OBS, SMALL, seed=1)
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


@pytest.mark.parametrize("name", [method.name for method in PAPER])
@pytest.mark.parametrize("stage", [1, 2, 3, 4])
def test_plans_of_the_method_table(name, stage):
    method = METHOD[name]
    graph = None if method.matrix == "none" else manual_graph(TASK)
    plan = stage_plan(TASK, method, graph, stage)
    if method.action_space == "full":
        assert plan.actions.tolist() == list(range(7))
        assert plan.mask.shape == (7, 1)
        expected = [stage in term.stages for term in TASK.terms]
        assert plan.reward_groups.tolist() == [expected]
    else:
        causal = {1: "armx army armz grip", 2: "armrx armry armrz grip", 3: "armz grip", 4: "grip"}[stage]
        assert [TASK.actions[k] for k in plan.actions] == causal.split()
        # One critic a row: what action k climbs is the sum of exactly the terms in its row of the matrix.
        matrix = training_matrix(TASK, graph, stage)[plan.actions]
        np.testing.assert_array_equal(plan.mask.sum(1), 1)
        np.testing.assert_array_equal(plan.mask @ plan.reward_groups, matrix)
        assert len(plan.reward_groups) == len(np.unique(matrix, axis=0))


def test_rows_and_terms_are_the_same_gradient_where_values_are_linear():
    """With critics that are linear in the reward (one layer, same weights) both forms give the same actor gradient."""
    graph, method = manual_graph(TASK), METHOD["cmmSAC"]
    rows, terms = (stage_plan(TASK, method, graph, 1, critics) for critics in ("rows", "terms"))
    g = torch.Generator().manual_seed(0)
    slope = torch.randn(len(TASK.terms), len(rows.actions), generator=g)  # dQ_j / da_k of every term
    by_row = (rows.mask @ (rows.reward_groups @ slope.numpy()) * np.eye(len(rows.actions))).sum(1)
    by_term = (terms.mask * (terms.reward_groups @ slope.numpy()).T).sum(1)
    np.testing.assert_allclose(by_row, by_term, atol=1e-6)


def test_paper_preset_has_the_papers_numbers():
    paper = PRESETS["SAC"]["paper"]
    assert (paper.gamma, paper.buffer_size, paper.train_every, paper.batch_size) == (0.99, 10_000, 1000, 512)
    assert (paper.learning_rate, paper.tau, paper.net_arch) == (5e-4, 0.005, (512, 512))
