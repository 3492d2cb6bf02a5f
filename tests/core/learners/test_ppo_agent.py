"""The learner's losses, gradients and advantages against stable-baselines3's PPO and against finite differences."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
import torch
from agents import MATRIX, plan
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.logger import configure

from causalbench.core.learners.ppo import losses
from causalbench.core.learners.ppo.agent import PPOAgent
from causalbench.core.learners.ppo.networks import Samples
from causalbench.core.learners.ppo.rollout import Steps, gae
from causalbench.core.learners.ppo.settings import PRESETS, PPOSettings
from causalbench.core.networks.gaussian import gaussian_actor, gaussian_log_prob
from causalbench.core.networks.stacked import mlp
from causalbench.errors import DivergedError

N_OBS, N = 5, 96
SMALL = PPOSettings(net_arch=(16, 16), batch_size=32, n_epochs=3, learning_rate=3e-3, ent_coef=0.01, target_kl=0.05)
ENGINES = pytest.mark.parametrize("engine", ["fused", "autograd"])


def _agent(mask, settings=SMALL, **changes) -> PPOAgent:
    """With a policy that depends on the state: the initial one hardly does."""
    agent = PPOAgent(plan(mask), N_OBS, dataclasses.replace(settings, **changes), seed=3)
    agent.networks.mean.weights[-2].mul_(50)
    return agent


def _samples(agent: PPOAgent, seed: int = 0) -> Samples:
    g = torch.Generator().manual_seed(seed)
    n_critics = len(agent.networks.mask)
    obs = torch.randn(N, N_OBS, generator=g)
    mean, log_std = gaussian_actor(agent.policy_weights, obs)
    actions = mean + log_std.exp() * torch.randn(mean.shape, generator=g)
    log_prob = gaussian_log_prob(mean, log_std, actions)
    return Samples(
        obs,
        actions,
        log_prob,
        torch.randn(N, n_critics, generator=g),
        torch.randn(N, n_critics, generator=g),
    )


def _env(n_actions: int) -> gym.Env:
    class Box(gym.Env):
        observation_space = gym.spaces.Box(-10, 10, (N_OBS,), np.float32)
        action_space = gym.spaces.Box(-1, 1, (n_actions,), np.float32)

    return Box()


def _sb3_layers(model: PPO) -> list[torch.nn.Linear]:
    policy = model.policy
    networks = (policy.mlp_extractor.policy_net, policy.action_net, policy.mlp_extractor.value_net, policy.value_net)
    return [layer for net in networks for layer in net.modules() if isinstance(layer, torch.nn.Linear)]


def _our_layers(agent: PPOAgent) -> list[tuple[torch.Tensor, torch.Tensor]]:
    weights = [w[0] for w in (*agent.networks.mean.weights, *agent.networks.values.weights)]
    return list(zip(weights[::2], weights[1::2], strict=True))


def _sb3_like(agent: PPOAgent, samples: Samples, **changes) -> PPO:
    """An SB3 PPO with the agent's settings and weights whose rollout holds `samples` of an agent with one critic."""
    s, n_actions = agent.settings, agent.networks.mask.shape[1]
    model = PPO(
        "MlpPolicy", _env(n_actions), n_steps=N, seed=0, device="cpu", batch_size=s.batch_size, n_epochs=s.n_epochs,
        learning_rate=s.learning_rate, gamma=s.gamma, gae_lambda=s.gae_lambda, clip_range=s.clip_range,
        ent_coef=s.ent_coef, vf_coef=s.vf_coef, max_grad_norm=s.max_grad_norm, target_kl=s.target_kl,
        policy_kwargs={"net_arch": list(s.net_arch)} | changes,
    )  # fmt: skip
    model.set_logger(configure(None, []))
    model._current_progress_remaining = 1.0
    with torch.no_grad():
        for layer, (kernel, bias) in zip(_sb3_layers(model), _our_layers(agent), strict=True):
            layer.weight.copy_(kernel.T)
            layer.bias.copy_(bias)
        model.policy.log_std.copy_(agent.networks.log_std)
    buffer = model.rollout_buffer
    buffer.observations[:, 0], buffer.actions[:, 0] = samples.obs, samples.actions
    buffer.log_probs[:, 0] = samples.log_prob.sum(1)
    buffer.advantages[:, 0], buffer.returns[:, 0] = samples.advantages[:, 0], samples.returns[:, 0]
    buffer.full = True
    return model


def _assert_same_weights(agent: PPOAgent, model: PPO) -> None:
    for layer, (kernel, bias) in zip(_sb3_layers(model), _our_layers(agent), strict=True):
        torch.testing.assert_close(kernel, layer.weight.T, atol=1e-5, rtol=1e-5)
        torch.testing.assert_close(bias, layer.bias, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(agent.networks.log_std, model.policy.log_std, atol=1e-5, rtol=1e-5)


@ENGINES
@pytest.mark.parametrize("target_kl", [1e9, 2e-3], ids=["all passes", "stopped by KL"])
def test_with_one_action_dimension_it_is_sb3s_ppo(engine, monkeypatch, target_kl):
    """Weights after whole passes with Adam: ratios, clipping, normaliser, entropy, gradient norm and KL stop agree."""
    agent = _agent([[1]], target_kl=target_kl, engine=engine)
    samples = _samples(agent)
    model = _sb3_like(agent, samples)
    orders = [np.random.default_rng(s).permutation(N) for s in range(SMALL.n_epochs)]
    theirs = iter(orders)
    monkeypatch.setattr(np.random, "permutation", lambda n: next(theirs))
    batches = [torch.from_numpy(rows) for order in orders for rows in np.split(order, N // SMALL.batch_size)]
    monkeypatch.setattr(agent, "_minibatches", lambda n: batches)
    agent.samples = samples
    agent.train()
    model.train()
    assert (agent.updates < len(batches)) == (target_kl < 1)
    _assert_same_weights(agent, model)


@ENGINES
def test_the_first_gradient_is_sb3s_in_any_number_of_dimensions(engine):
    """At ratio 1 the summed gradients of the per-dimension ratios are the joint one; SGD at rate 1 shows gradients."""
    settings = dataclasses.replace(SMALL, batch_size=N, n_epochs=1, max_grad_norm=1e9, learning_rate=1.0)
    agent = _agent(np.ones((4, 1)), settings, engine=engine)
    samples = _samples(agent)
    model = _sb3_like(agent, samples, optimizer_class=torch.optim.SGD)
    agent.optimizer = torch.optim.SGD(agent.networks.blocks, 1.0)
    before = [w.detach().clone() for w in agent.networks.blocks]
    agent.samples = samples
    agent.train()
    model.train()
    assert all((w != old).any() for w, old in zip(agent.networks.blocks, before, strict=True))
    _assert_same_weights(agent, model)


def test_gae_is_that_of_sb3s_rollout_buffer():
    """With ends, time limits (SB3 adds their bootstrapped value to the reward) and an epoch cut in mid-episode."""
    rng = np.random.default_rng(0)
    n_steps, n_envs = 40, 3
    gamma, gae_lambda = 0.97, 0.9
    rewards, values, reached = rng.standard_normal((3, n_steps, n_envs)).astype(np.float32)
    done, over = rng.random((2, n_steps, n_envs)) < 0.15
    done[7, 0] = over[7, 0] = True
    buffer = RolloutBuffer(
        n_steps, gym.spaces.Box(-1, 1, (1,)), gym.spaces.Box(-1, 1, (1,)), "cpu", gae_lambda, gamma, n_envs
    )
    starts = np.ones(n_envs, dtype=bool)
    for t in range(n_steps):
        timeout = over[t] & ~done[t]
        reward = rewards[t] + gamma * reached[t] * timeout
        nothing = np.zeros((n_envs, 1))
        buffer.add(nothing, nothing, reward, starts, torch.from_numpy(values[t]), torch.zeros(n_envs))
        starts = done[t] | over[t]
    buffer.compute_returns_and_advantage(torch.from_numpy(reached[-1]), starts)
    goes_on = ~(done | over)
    next_values = np.where(goes_on, np.concatenate([values[1:], reached[-1:]]), np.where(done, 0, reached))
    ours = gae(rewards[..., None], values[..., None], next_values[..., None], goes_on, gamma, gae_lambda)
    np.testing.assert_allclose(ours[..., 0], buffer.advantages, atol=1e-5)


def test_an_agents_own_episode_is_the_stretch_inside_its_stage():
    """Advantages of interleaved stages against each stretch by itself, step by step from the definition."""
    agent = _agent(np.ones((2, 2)))
    g = torch.Generator().manual_seed(1)
    stage = torch.tensor([1, 1, 2, 2, 1, 1, 1, 1, 2, 1])[:, None]
    next_stage = torch.tensor([1, 2, 2, 1, 1, 1, 1, 2, 1, 1])[:, None]
    over = torch.zeros(10, 1, dtype=torch.bool)
    over[5] = True  # a time limit in stage 1
    steps = Steps(
        torch.randn(10, 1, N_OBS, generator=g), torch.randn(10, 1, 2, generator=g), torch.randn(10, 1, 2, generator=g),
        torch.randn(10, 1, N_OBS, generator=g), stage, stage != next_stage, over,
    )  # fmt: skip
    agent.collect(steps, stage=1)
    gamma, lam = agent.settings.gamma, agent.settings.gae_lambda
    weights = [w[0] for w in agent.networks.values.weights]
    values, reached = (mlp(weights, obs[:, 0], "tanh") for obs in (steps.obs, steps.next_obs))
    expected = []
    for stretch, ends in (((0, 1), True), ((4, 5), False), ((6, 7), True), ((9,), False)):
        for start in stretch:
            total = torch.zeros(2)
            for t in range(start, stretch[-1] + 1):
                after = torch.zeros(2) if ends and t == stretch[-1] else reached[t]
                total += (gamma * lam) ** (t - start) * (steps.rewards[t, 0] + gamma * after - values[t])
            expected.append(total)
    own = torch.tensor([0, 1, 4, 5, 6, 7, 9])
    torch.testing.assert_close(agent.samples.advantages, torch.stack(expected))
    torch.testing.assert_close(agent.samples.returns, torch.stack(expected) + values[own])
    torch.testing.assert_close(agent.samples.actions, steps.actions[own, 0])


@ENGINES
@pytest.mark.usefixtures("double_precision")
def test_factored_gradient_equals_finite_differences_of_the_masked_objective(engine):
    """Central differences in float64 of sum_k E[min(r_k A_k, clip(r_k) A_k)], A_k from the terms that k causes."""
    agent = _agent(MATRIX, ent_coef=0.0, engine=engine)
    samples = _samples(agent)
    samples = samples._replace(log_prob=samples.log_prob + 0.3 * torch.sin(torch.arange(3.0 * N)).view(N, 3))

    def log_ratio() -> torch.Tensor:
        mean, log_std = gaussian_actor(agent.policy_weights, samples.obs)
        return gaussian_log_prob(mean, log_std, samples.actions) - samples.log_prob

    def objective() -> float:
        """Written out anew, action by action and sample by sample."""
        ratio = log_ratio().exp().numpy()
        wanted = np.array([[sum(a[j] for j in range(3) if MATRIX[k][j]) for k in range(3)] for a in advantages])
        deviations = wanted.std(0, ddof=1)
        total = 0.0
        for k in range(3):
            scale = max(deviations[k], 0.1 * deviations.mean())
            for n in range(N):
                a = (wanted[n, k] - wanted[:, k].mean()) / scale
                total += min(ratio[n, k] * a, float(np.clip(ratio[n, k], 0.8, 1.2)) * a) / N
        return total

    advantages = samples.advantages.numpy()
    networks = agent.networks
    loss = agent.engine.policy_gradient(networks, samples, agent.engine.judge(networks, samples))
    assert loss.item() == pytest.approx(-objective())
    step = 1e-6
    for w, gradient in zip(networks.blocks[:2], (networks.mean.flat.grad, networks.log_std.grad), strict=True):
        for i in range(0, w.numel(), 17 if w.numel() > 17 else 1):
            numeric = 0.0
            for sign in (1, -1):
                w[i] += sign * step
                numeric -= sign * objective() / (2 * step)
                w[i] -= sign * step
            assert gradient[i].item() == pytest.approx(numeric, rel=1e-4, abs=1e-6)


@ENGINES
def test_an_action_that_causes_nothing_gets_no_gradient(engine):
    agent = _agent([[1], [0], [1]], engine=engine)
    samples = _samples(agent)
    agent.engine.policy_gradient(agent.networks, samples, agent.engine.judge(agent.networks, samples))
    by_action = agent.networks.mean.gradients[-1][0]
    assert by_action[1] == 0
    assert (by_action[[0, 2]] != 0).all()


def test_the_normaliser_has_a_floor():
    """An action whose advantage is all but constant must not be blown up to the size of the others'."""
    advantages = torch.randn(N, 3, generator=torch.Generator().manual_seed(0)) * torch.tensor([1.0, 2.0, 1e-4])
    std = losses.normalise(advantages, 0.1).std(0)
    torch.testing.assert_close(std[:2], torch.ones(2))
    assert std[2] < 2e-3


def test_the_entropy_is_the_normal_distributions():
    log_std = torch.tensor([-0.5, 0.3])
    torch.testing.assert_close(losses.entropy(log_std), torch.distributions.Normal(0, log_std.exp()).entropy().sum())


def test_permuting_reward_terms_changes_nothing():
    order = [2, 0, 1]
    one, two = _agent(MATRIX), _agent(np.array(MATRIX)[:, order])
    for w in two.networks.values.weights[-2:]:
        w.copy_(w[..., order].clone())
    samples = _samples(one)
    one.samples = samples
    two.samples = samples._replace(advantages=samples.advantages[:, order], returns=samples.returns[:, order])
    one.train()
    two.train()
    for w, v in zip(one.policy_weights, two.policy_weights, strict=True):
        torch.testing.assert_close(w, v, atol=1e-6, rtol=1e-6)


def test_too_few_samples_wait_for_more_and_every_sample_is_used_once_a_pass():
    agent = _agent([[1]])
    samples = _samples(agent)
    agent.samples = samples.rows(torch.arange(31))
    agent.train()
    assert (agent.updates, len(agent.samples.obs)) == (0, 31)
    batches = agent._minibatches(75)
    assert [len(rows) for rows in batches] == [38, 37] * SMALL.n_epochs
    for first, second in zip(batches[::2], batches[1::2], strict=True):
        assert sorted(torch.cat([first, second]).tolist()) == list(range(75))
    agent.samples = samples
    agent.train()
    assert (agent.updates, len(agent.samples.obs)) == (9, 0)


@ENGINES
def test_a_loss_that_is_not_finite_ends_training(engine):
    agent = _agent([[1]], engine=engine)
    samples = _samples(agent)
    agent.samples = samples._replace(returns=samples.returns * float("nan"))
    with pytest.raises(DivergedError, match="not finite after 9 updates"):
        agent.train()


def test_paper_preset_has_the_papers_numbers():
    paper = PRESETS["paper"]
    assert (paper.gamma, paper.learning_rate, paper.clip_range) == (0.99, 5e-5, 0.2)
    assert (paper.n_steps, paper.batch_size, paper.n_epochs, paper.net_arch) == (10_000, 64, 10, (64, 64))
