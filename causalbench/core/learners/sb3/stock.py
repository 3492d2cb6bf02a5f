"""Reference rows: stable-baselines3's own SAC and PPO, one agent for all stages, on the summed reward.

Same networks, observations, rewards and entropy start as the staged learners; counted and evaluated the same way.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecEnv
from torch import Tensor

from causalbench.core.learners.counting import Counter
from causalbench.core.learners.evaluation import evaluate
from causalbench.core.learners.policy import ObservationScale, StagedPolicy
from causalbench.core.learners.ppo.settings import PPOSettings
from causalbench.core.learners.records import Evaluation, TrainingCounts
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.learners.settings import EvaluationSettings, LearnerSettings
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.vector_env import StageTaskVectorEnv
from causalbench.errors import DivergedError


class SummedRewardEnv(VecEnv):
    """`StageTaskVectorEnv` as SB3 wants it: scaled observations (n, n_obs), the reward a sum; counts what happens."""

    def __init__(self, env: StageTaskVectorEnv, scale: ObservationScale, seed: int) -> None:
        self.env, self.scale, self.first_seed = env, scale, seed
        self.counter = Counter(env.task.n_stages, env.num_envs)
        self.stage = np.ones(env.num_envs, dtype=np.int64)
        self._actions: NDArray[Any] = np.zeros((env.num_envs, len(env.task.actions)))
        n_obs = len(scale.low)
        super().__init__(env.num_envs, gym.spaces.Box(-1.0, 1.0, (n_obs,), np.float32), env.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        """New starts in every world, the same for every method with this seed."""
        obs, _ = self.env.reset(seed=self.first_seed)
        return self.scale(obs).numpy()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[np.bool_], list[dict[str, Any]]]:
        """One control step of every world."""
        obs, rewards, terminated, truncated, infos = self.env.step(self._actions)
        over = terminated | truncated
        self.counter.add(infos, over)
        self.stage = obs["stage"] + 1
        final_obs = self.scale(infos["final_obs"]).numpy()
        sb3_infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for world in np.flatnonzero(over):
            sb3_infos[world] = {
                "terminal_observation": final_obs[world],
                "TimeLimit.truncated": bool(truncated[world] and not terminated[world]),
            }
        return self.scale(obs).numpy(), rewards.astype(np.float32), over, sb3_infos

    def close(self) -> None:
        """The owner of the worlds closes them."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Of the vector environment, the same for each world."""
        return [getattr(self.env, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Nothing to set: the worlds are one batch."""
        raise AttributeError(attr_name)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Nothing to call: the worlds are one batch."""
        raise AttributeError(method_name)

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: Any = None) -> list[bool]:
        """No wrappers."""
        return [False] * self.num_envs


def make_stock(settings: LearnerSettings, env: SummedRewardEnv, seed: int) -> SAC | PPO:
    """SB3's agent with what `settings` has in common with it; SAC's buffer has room for the samples of all stages."""
    shared: dict[str, Any] = {
        "learning_rate": settings.learning_rate,
        "batch_size": settings.batch_size,
        "gamma": settings.gamma,
        "seed": seed,
        "device": "cpu",
    }
    arch: dict[str, Any] = {"net_arch": list(settings.net_arch)}
    model: SAC | PPO
    if isinstance(settings, PPOSettings):
        model = PPO(
            "MlpPolicy", env, n_steps=max(1, settings.n_steps // settings.n_envs), n_epochs=settings.n_epochs,
            gae_lambda=settings.gae_lambda, clip_range=settings.clip_range, target_kl=settings.target_kl,
            ent_coef=settings.ent_coef, vf_coef=settings.vf_coef, max_grad_norm=settings.max_grad_norm,
            policy_kwargs=arch | {"log_std_init": settings.log_std_init}, **shared,
        )  # fmt: skip
    else:
        every = max(1, settings.train_every // settings.n_envs)
        model = SAC(
            "MlpPolicy", env, buffer_size=settings.buffer_size * env.env.task.n_stages, tau=settings.tau,
            learning_starts=settings.learning_starts, train_freq=(every, "step"),
            gradient_steps=max(1, int(every * settings.n_envs * settings.updates_per_sample)),
            ent_coef=f"auto_{settings.ent_coef_init}", policy_kwargs=arch, **shared,
        )  # fmt: skip
    model.set_logger(configure(None, []))
    return model


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
    """Evaluates and reports as the staged learners' loop does, and ends training at the exact step."""

    def __init__(
        self,
        policy: StagedPolicy,
        judge_env: StageTaskEnv,
        evaluation: EvaluationSettings,
        env_steps: int,
        on_evaluation: Callable[[Evaluation, TrainingCounts], None],
        on_progress: Callable[[float, str], None],
    ) -> None:
        super().__init__()
        self.policy, self.judge_env, self.evaluation, self.env_steps = policy, judge_env, evaluation, env_steps
        self.on_evaluation, self.on_progress = on_evaluation, on_progress

    def _on_step(self) -> bool:
        env: Any = self.training_env
        counts: TrainingCounts = env.counter.counts
        taken = counts.env_steps
        self.on_progress(min(1.0, taken / self.env_steps), f"stage {int(env.stage.max())}")
        if episodes := self.evaluation.episodes_due(taken - env.num_envs, taken, self.env_steps):
            show(self.model, self.policy)  # type: ignore[arg-type]
            updates = _updates(self.model)  # type: ignore[arg-type]
            counts.updates = dict.fromkeys(range(1, self.judge_env.task.n_stages + 1), updates)
            self.on_evaluation(evaluate(self.policy, self.judge_env, episodes, taken), counts)
        return taken < self.env_steps


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


def train_stock(
    env: StageTaskVectorEnv,
    judge_env: StageTaskEnv,
    settings: LearnerSettings,
    evaluation: EvaluationSettings,
    env_steps: int,
    seed: int,
    on_evaluation: Callable[[Evaluation, TrainingCounts], None],
    on_progress: Callable[[float, str], None],
) -> tuple[StagedPolicy, TrainingCounts]:
    """SB3's `learn` for `env_steps` control steps; see `training.train`. Raises `DivergedError`."""
    scale = ObservationScale.of(env.single_observation_space)
    n_stages, n_actions = env.task.n_stages, len(env.task.actions)
    worlds = SummedRewardEnv(env, scale, seed)
    with _global_generators_kept():
        model = make_stock(settings, worlds, seed)
        policy = StagedPolicy(
            [exported_actor(model)] * n_stages,
            [np.arange(n_actions)] * n_stages,
            n_actions,
            scale,
            "squashed" if isinstance(settings, SACSettings) else "gaussian",
            seed=seed,
        )
        watch = _Watch(policy, judge_env, evaluation, env_steps, on_evaluation, on_progress)
        try:
            model.learn(env_steps + settings.n_envs, callback=watch)
        except ValueError:  # torch's distributions refuse weights that are not numbers
            show(model, policy)
            raise
    return policy, worlds.counter.counts


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
