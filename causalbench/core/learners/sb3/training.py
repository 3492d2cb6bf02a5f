"""Reference rows: stable-baselines3's own SAC and PPO, one agent for all stages, on one reward a step.

Same networks, observations and entropy start as the staged learners; counted and evaluated the same way.
"""

from __future__ import annotations

import logging
import random
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from torch import Tensor

from causalbench.core.learners.examiner import Examiner
from causalbench.core.learners.policy import Distribution, ObservationScale, StagedPolicy
from causalbench.core.learners.records import TrainingCounts
from causalbench.core.learners.registry import Trained, TrainingProblem
from causalbench.core.learners.sb3.scalar_reward_env import ScalarRewardEnv
from causalbench.core.learners.sb3.settings import SB3PPOSettings, SB3SACSettings
from causalbench.core.learners.scalars import make_scalar
from causalbench.errors import DivergedError, UserError

LOG = logging.getLogger(__name__)


def train_sac(problem: TrainingProblem) -> Trained:
    """Run the `learn` of stable-baselines3's SAC for the problem's control steps. Raises `DivergedError`."""
    return _train(problem, make_sac, "squashed")


def train_ppo(problem: TrainingProblem) -> Trained:
    """Run the `learn` of stable-baselines3's PPO for the problem's control steps. Raises `DivergedError`."""
    return _train(problem, make_ppo, "gaussian")


def make_sac(settings: SB3SACSettings, env: ScalarRewardEnv, seed: int) -> SAC:
    """SB3's SAC; its buffer has room for the samples of all stages."""
    every = max(1, settings.train_every // settings.n_envs)
    return SAC(
        "MlpPolicy", env, buffer_size=settings.buffer_size * env.env.task.n_stages, tau=settings.tau,
        learning_starts=settings.learning_starts, train_freq=(every, "step"),
        gradient_steps=max(1, int(every * settings.n_envs * settings.updates_per_sample)),
        ent_coef=f"auto_{settings.ent_coef_init}", policy_kwargs={"net_arch": list(settings.net_arch)},
        **_shared(settings, seed),
    )  # fmt: skip


def make_ppo(settings: SB3PPOSettings, env: ScalarRewardEnv, seed: int) -> PPO:
    """SB3's PPO."""
    return PPO(
        "MlpPolicy", env, n_steps=max(1, settings.n_steps // settings.n_envs), n_epochs=settings.n_epochs,
        gae_lambda=settings.gae_lambda, clip_range=settings.clip_range, target_kl=settings.target_kl,
        ent_coef=settings.ent_coef, vf_coef=settings.vf_coef, max_grad_norm=settings.max_grad_norm,
        policy_kwargs={"net_arch": list(settings.net_arch), "log_std_init": settings.log_std_init},
        **_shared(settings, seed),
    )  # fmt: skip


def _shared(settings: SB3SACSettings | SB3PPOSettings, seed: int) -> dict[str, Any]:
    """The arguments that both agents take."""
    return {
        "learning_rate": settings.learning_rate,
        "batch_size": settings.batch_size,
        "gamma": settings.gamma,
        "seed": seed,
        "device": "cpu",
    }


def exported_actor(model: SAC | PPO) -> list[Tensor]:
    """The actor's weights in the layout of `StagedPolicy`: "squashed" for SAC, "gaussian" for PPO."""
    if isinstance(model, SAC):
        mu, log_std = _layers(model.actor.mu), _layers(model.actor.log_std)  # type: ignore[arg-type]
        last = [torch.cat(pair, -1) for pair in zip(mu, log_std, strict=True)]
        return [w.detach().contiguous() for w in (*_layers(model.actor.latent_pi), *last)]
    policy = model.policy
    weights = [*_layers(policy.mlp_extractor.policy_net), *_layers(policy.action_net), policy.log_std]
    return [w.detach().clone().contiguous() for w in weights]


def _layers(network: torch.nn.Module) -> list[Tensor]:
    """[W1, b1, ...], W (n_in, n_out)."""
    linears = [layer for layer in network.modules() if isinstance(layer, torch.nn.Linear)]
    return [w for layer in linears for w in (layer.weight.T, layer.bias)]


class _Watch(BaseCallback):
    """Evaluates and reports as the staged loop does, and ends training at the exact step."""

    def __init__(self, policy: StagedPolicy, examiner: Examiner) -> None:
        super().__init__()
        self.policy, self.examiner = policy, examiner

    def _on_step(self) -> bool:
        env: Any = self.training_env
        counts: TrainingCounts = env.counter.counts
        before = counts.env_steps - env.num_envs
        if self.examiner.is_due(before, counts.env_steps, f"stage {int(env.stage.max())}"):
            show(self.model, self.policy)  # type: ignore[arg-type]
            updates = _updates(self.model)  # type: ignore[arg-type]
            counts.updates = dict.fromkeys(range(1, len(self.policy.actors) + 1), updates)
            self.examiner.examine(self.policy, counts)
        return counts.env_steps < self.examiner.problem.env_steps and not self.examiner.settled


def show(model: SAC | PPO, policy: StagedPolicy) -> None:
    """Put the model's newest weights into `policy`, the same for every stage. Raises `DivergedError`."""
    actor = exported_actor(model)
    if not all(bool(torch.isfinite(w).all()) for w in actor):
        raise DivergedError(
            f"env step {model.num_timesteps}, a weight of the policy is not finite after {_updates(model)} updates"
        )
    policy.actors = [actor] * len(policy.actors)


def _updates(model: SAC | PPO) -> int:
    """Gradient updates so far: SB3's own counter counts PPO's passes."""
    optimizer = model.actor.optimizer if isinstance(model, SAC) else model.policy.optimizer
    return max((int(state["step"]) for state in optimizer.state.values()), default=0)


def _train(problem: TrainingProblem, make: Callable[..., SAC | PPO], distribution: Distribution) -> Trained:
    settings, name = problem.settings, problem.method.name
    if settings.observation == "paper":
        raise UserError(f"method {name!r} has no convolutions: it cannot have `observation: paper`")
    if problem.checkpoints:
        LOG.info("stable-baselines3's own agents keep no checkpoints")
    with closing(problem.vector_env(settings.n_envs)) as env, closing(Examiner(problem)) as examiner:
        scale = ObservationScale.of(env.single_observation_space, problem.task)
        scalar = make_scalar(settings.scalar, problem.task, settings.n_envs, settings.gamma)
        worlds = ScalarRewardEnv(env, scale, scalar, problem.seed)
        with _global_generators_kept():
            model = make(settings, worlds, problem.seed)
            model.set_logger(Logger(None, []))
            policy = _policy(model, worlds, distribution, problem.seed)
            _learn(model, policy, problem.env_steps + settings.n_envs, _Watch(policy, examiner))
    return Trained(policy, worlds.counter.counts)


def _policy(model: SAC | PPO, worlds: ScalarRewardEnv, distribution: Distribution, seed: int) -> StagedPolicy:
    """The model's actor as the actor of every stage."""
    task = worlds.env.task
    actors, actions = [exported_actor(model)] * task.n_stages, [np.arange(len(task.actions))] * task.n_stages
    return StagedPolicy(actors, actions, len(task.actions), worlds.scale, distribution, seed)


def _learn(model: SAC | PPO, policy: StagedPolicy, env_steps: int, watch: BaseCallback) -> None:
    try:
        model.learn(env_steps, callback=watch)
    except ValueError:  # torch's distributions refuse weights that are not numbers
        show(model, policy)
        raise


@contextmanager
def _global_generators_kept() -> Iterator[None]:
    """SB3 seeds and uses the global generators; others in this process must not notice."""
    kept = random.getstate(), np.random.get_state(), torch.get_rng_state()  # noqa: NPY002 - SB3's
    try:
        yield
    finally:
        random.setstate(kept[0])
        np.random.set_state(kept[1])  # noqa: NPY002
        torch.set_rng_state(kept[2])
