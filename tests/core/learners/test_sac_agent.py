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
from causalbench.core.learners.sac.agent import SACAgent
from causalbench.core.learners.sac.buffer import Batch, StageBuffer
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.learners.settings import PRESETS
from causalbench.core.networks.squashed_gaussian import LOG_STD_MAX, actor_forward, squashed_sample
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
        actor = agent.policy_weights
        for layer, w, b in zip(layers, actor[:-2:2], actor[1:-2:2], strict=True):
            layer.weight.copy_(w.T)
            layer.bias.copy_(b)
        for head, columns in ((model.actor.mu, slice(0, N_ACTIONS)), (model.actor.log_std, slice(N_ACTIONS, None))):
            head.weight.copy_(actor[-2][:, columns].T)
            head.bias.copy_(actor[-1][columns])
        for networks, weights in ((model.critic, agent.critics.weights), (model.critic_target, agent.targets.weights)):
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


@pytest.mark.parametrize("gradient_descent", [True, False], ids=["gradients", "adam"])
def test_one_critic_and_an_all_ones_matrix_is_sb3s_sac(gradient_descent, same_noise, monkeypatch):
    """After SGD at rate 1 the weights differ from the start by exactly the gradients; after Adam by its step."""
    agent = SACAgent(_plan(np.ones((N_ACTIONS, 1))), N_OBS, SMALL, seed=3)
    model = _sb3_with_weights_of(agent, gradient_descent)
    if gradient_descent:
        agent.actor_optimizer = torch.optim.SGD([agent.actor.flat, agent.log_alpha], 1.0)
        agent.critic_optimizer = torch.optim.SGD([agent.critics.flat], 1.0)
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
    trained = (agent.policy_weights, agent.critics.weights, agent.targets.weights)
    for ours, theirs in zip(trained, _sb3_weights(model), strict=True):
        for w, expected in zip(ours, theirs, strict=True):
            torch.testing.assert_close(w, expected.detach(), atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(agent.log_alpha, model.log_ent_coef.detach(), atol=1e-5, rtol=1e-5)


@pytest.fixture
def double_precision():
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


def _critics(agent: SACAgent, obs: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
    """(2, n_critics, batch) of both twins, net by net."""
    x = torch.cat([obs, action], 1)
    outputs = []
    for w1, b1, w2, b2, w3, b3 in zip(*agent.critics.weights, strict=True):
        outputs.append((torch.relu(torch.relu(x @ w1 + b1) @ w2 + b2) @ w3 + b3).T)
    return torch.cat(outputs).view(2, -1, len(obs))


MASK = [[1, 0, 1], [0, 1, 1], [1, 1, 0]]
FORMS = pytest.mark.parametrize(
    ("critics", "joint_twin"), [("rows", False), ("heads", False), ("terms", True)], ids=["rows", "heads", "terms"]
)


@FORMS
@pytest.mark.usefixtures("double_precision")
def test_factored_gradient_equals_finite_differences_of_the_masked_objective(critics, joint_twin):
    """Gradient of sum_c Q_c(s, a with the dimensions that do not cause c frozen) by central differences in float64."""
    plan = _plan(MASK, joint_twin, entropy=[False, False, True])
    agent = SACAgent(plan, N_OBS, dataclasses.replace(SMALL, critics=critics), seed=1)
    obs = _batch(3).obs
    frozen = torch.rand(BATCH, N_ACTIONS, generator=torch.Generator().manual_seed(4)) * 2 - 1
    matrix = torch.tensor(MASK)

    def objective(action):
        """Written out anew, loop by loop: what the causal policy gradient maximises."""
        twins = torch.zeros(2, 3, BATCH)
        for c in range(3):
            twins[:, c] = _critics(agent, obs, torch.where(matrix[:, c].bool(), action, frozen))[:, c]
        if joint_twin:
            return torch.minimum(twins[0].sum(0), twins[1].sum(0))
        return torch.minimum(twins[0], twins[1]).sum(0)

    value, gradient = agent.masked_value(obs, frozen)
    torch.testing.assert_close(value, objective(frozen))
    step = 1e-6
    for k in range(N_ACTIONS):
        bump = torch.zeros(N_ACTIONS)
        bump[k] = step
        numeric = (objective(frozen + bump) - objective(frozen - bump)) / (2 * step)
        torch.testing.assert_close(gradient[:, k], numeric, atol=1e-6, rtol=1e-5)


@FORMS
@pytest.mark.usefixtures("double_precision")
def test_written_out_gradients_are_autograds(critics, joint_twin):
    """All three losses, with a log std outside its bounds too, against the same losses recorded by autograd."""
    plan = _plan(MASK, joint_twin, entropy=[False, True, True])
    agent = SACAgent(plan, N_OBS, dataclasses.replace(SMALL, critics=critics), seed=1)
    batch, noise = _batch(3), torch.randn(2 * BATCH, N_ACTIONS, generator=torch.Generator().manual_seed(5))
    log_std = agent.actor.forward(batch.obs)[-1][0, :, -1]
    agent.actor.weights[-1][0, -1] += LOG_STD_MAX - log_std.median()  # half of them beyond it
    agent._noise = lambda shape: noise
    alpha = torch.tensor([0.3])
    drawn = agent.draw(torch.cat([batch.obs, batch.next_obs]))
    now, following = drawn.rows(slice(BATCH)), drawn.rows(slice(BATCH, None))
    critic_loss = agent.critic_gradient(batch, following, alpha)
    actor_loss = agent.actor_gradient(batch.obs, now, alpha)
    agent.alpha_gradient(now.log_prob)

    with torch.enable_grad():
        actor = [w.clone().requires_grad_() for w in agent.policy_weights]
        critics_weights = [w.clone().requires_grad_() for w in agent.critics.weights]
        mean, log_std = actor_forward(actor, batch.obs)
        assert 0 < (log_std[:, -1] == LOG_STD_MAX).sum() < BATCH
        action, log_prob = squashed_sample(mean, log_std, noise[:BATCH])
        mask = agent.mask.bool()

        def lesser(twins):
            if not joint_twin:
                return twins.amin(0)
            return torch.where(twins[0].sum(0) <= twins[1].sum(0), twins[0], twins[1])

        q = torch.stack(
            [_critics(agent, batch.obs, torch.where(m, action, action.detach()))[:, c] for c, m in enumerate(mask)], 1
        )
        expected = (0.3 * log_prob - lesser(q).sum(0)).mean()
        torch.testing.assert_close(actor_loss, expected.detach())
        for ours, theirs in zip(agent.actor.gradients, torch.autograd.grad(expected, actor), strict=True):
            torch.testing.assert_close(ours[0], theirs, atol=1e-9, rtol=1e-6)

        next_q = lesser(_critics(agent, batch.next_obs, following.action))  # the targets are still the critics
        soft = next_q - agent.entropy * (0.3 * following.log_prob)
        target = batch.rewards.T + 0.99 * (1 - batch.done) * soft
        agent.critics.weights = critics_weights
        expected = 0.5 * (_critics(agent, batch.obs, batch.actions) - target).pow(2).mean(-1).sum()
        torch.testing.assert_close(critic_loss, expected.detach())
        for ours, theirs in zip(agent.critics.gradients, torch.autograd.grad(expected, critics_weights), strict=True):
            torch.testing.assert_close(ours, theirs, atol=1e-9, rtol=1e-6)

        log_alpha = agent.log_alpha.clone().requires_grad_()
        expected = -(log_alpha * (log_prob.detach() - N_ACTIONS)).mean()
        torch.testing.assert_close(agent.log_alpha.grad, torch.autograd.grad(expected, log_alpha)[0])


def test_an_action_that_causes_nothing_gets_no_gradient():
    agent = SACAgent(_plan([[1], [0], [1]]), N_OBS, SMALL, seed=1)
    gradient = agent.masked_value(_batch(1).obs, torch.zeros(BATCH, N_ACTIONS))[1]
    assert (gradient[:, 1] == 0).all()
    assert (gradient[:, [0, 2]] != 0).any(0).all()


def test_permuting_reward_terms_changes_nothing():
    """Critics, rewards and mask in another order: the same actor after the same updates."""
    order = [2, 0, 1]
    mask = np.array([[1, 0, 1], [0, 1, 1], [1, 1, 0]])
    one = SACAgent(_plan(mask), N_OBS, SMALL, seed=1)
    two = SACAgent(_plan(mask[:, order]), N_OBS, SMALL, seed=1)
    rows = torch.tensor([*order, *(3 + i for i in order)])
    for networks in (two.critics, two.targets):
        for w in networks.weights:
            w.copy_(w[rows].clone())
    batch = _batch(3)
    one.buffer.sample = lambda *a: batch
    two.buffer.sample = lambda *a: batch._replace(rewards=batch.rewards[:, order])
    one.train(5)
    two.train(5)
    for w, v in zip(one.actor.weights, two.actor.weights, strict=True):
        torch.testing.assert_close(w, v, atol=1e-6, rtol=1e-6)


def test_cooperation_mixes_the_next_stages_critic():
    """The gradient at the outputs of a policy without temperature, and the loss."""
    settings = dataclasses.replace(SMALL, cooperation_weight=0.3)
    agent, following = (SACAgent(_plan(np.ones((N_ACTIONS, 1))), N_OBS, settings, seed=s) for s in (1, 2))
    obs, nothing = _batch(1).obs, torch.zeros(1)
    drawn = agent.draw(obs)
    (own, own_slope), (other, other_slope) = (a.masked_value(obs, drawn.action) for a in (agent, following))
    own_scale = 0.99 + 0.01 * own.abs().mean()  # the running means start at 1
    other_scale = 0.99 + 0.01 * other.abs().mean()
    loss = agent.actor_gradient(obs, drawn, nothing, following)
    torch.testing.assert_close(loss, -(0.7 * own + 0.3 * other * own_scale / other_scale).mean())
    slope = 0.7 * own_slope + 0.3 * other_slope * own_scale / other_scale
    by_mean = -(slope * (1 - drawn.action**2)).mean(0)
    torch.testing.assert_close(agent.actor.gradients[-1][0, :N_ACTIONS], by_mean)


def test_temperature_aims_at_the_agents_own_number_of_actions():
    for n in (1, 4):
        agent = SACAgent(_plan(np.ones((n, 1))), N_OBS, SMALL, seed=1)
        for entropy, direction in ((-n - 0.5, 1), (-n + 0.5, -1)):  # too little entropy: alpha must rise
            agent.alpha_gradient(torch.full((BATCH,), -float(entropy)))
            assert torch.sign(-agent.log_alpha.grad).item() == direction


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
