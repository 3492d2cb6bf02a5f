"""Evaluation: full task episodes from stage 1 on fixed seeds, deterministic and sampled."""

from __future__ import annotations

from typing import Any

import numpy as np

from causalbench.core.learners.records import Episode, Evaluation
from causalbench.core.learners.registry import Policy
from causalbench.core.learners.settings import FIRST_START
from causalbench.core.staged.env import StageTaskEnv


def evaluate(
    policy: Policy, env: StageTaskEnv, episodes: int, env_steps: int, first_start: int = FIRST_START
) -> Evaluation:
    """`episodes` deterministic and as many sampled episodes; every success is put to the task's own test.

    `env_steps` is the training step to report. Start i is drawn with the seed `first_start` + i, for both alike. The
    sampled episodes use the policy's own generator.
    """
    certain = [_play(policy, env, first_start, i, True) for i in range(episodes)]
    sampled = [_play(policy, env, first_start, i, False) for i in range(episodes)]
    tested = [episode.held for episode in (*certain, *sampled) if episode.held is not None]
    returns = np.mean([[*episode.returns.values()] for episode in certain], axis=0)
    return Evaluation(
        env_steps=env_steps,
        episodes=episodes,
        success_deterministic=float(np.mean([episode.success for episode in certain])),
        success_sampled=float(np.mean([episode.success for episode in sampled])),
        held_rate=float(np.mean(tested)) if tested else None,
        reversals_per_episode=float(np.mean([episode.reversals for episode in certain])),
        mean_final_stage=float(np.mean([episode.final_stage for episode in certain])),
        mean_length=float(np.mean([episode.length for episode in certain])),
        term_returns=dict(zip(env.reward_names, map(float, returns), strict=True)),
        played=(*certain, *sampled),
    )


def _play(policy: Policy, env: StageTaskEnv, first_start: int, number: int, deterministic: bool) -> Episode:
    obs, _ = env.reset(seed=first_start + number, options={"stage": 1})
    returns, stages, over = np.zeros(len(env.reward_names)), list[int](), False
    info: dict[str, Any] = {}
    while not over:
        action, _ = policy.predict(obs, deterministic=deterministic)
        obs, _, terminated, truncated, info = env.step(action)
        returns += info["vector_reward"]
        stages.append(info["stage"])
        over = terminated or truncated
    success = bool(info["is_success"])
    return Episode(
        episode=number,
        deterministic=deterministic,
        success=success,
        held=env.worlds.after_success(0) if success else None,
        n_stages=env.task.n_stages,
        stages=tuple(stages),
        final_stage=env.task.n_stages + 1 if success else int(info["next_stage"]),
        returns=dict(zip(env.reward_names, map(float, returns), strict=True)),
    )
