"""Evaluation: full task episodes from stage 1 on fixed seeds, deterministic and sampled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.core.learners.records import Evaluation
from causalbench.core.learners.registry import Policy
from causalbench.core.learners.settings import FIRST_START
from causalbench.core.staged.env import StageTaskEnv


@dataclass
class _Outcome:
    success: bool
    held: bool | None  # whether the success stood the task's test; None without success or test
    reversals: int
    final_stage: int  # n_stages + 1 on success
    length: int
    returns: NDArray[np.float64]  # (n_terms,)


def evaluate(
    policy: Policy, env: StageTaskEnv, episodes: int, env_steps: int, first_start: int = FIRST_START
) -> Evaluation:
    """`episodes` deterministic and as many sampled episodes; every success is put to the task's own test.

    `env_steps` is the training step to report. Start i is drawn with the seed `first_start` + i, for both alike. The
    sampled episodes use the policy's own generator.
    """
    certain = [_episode(policy, env, first_start + i, True) for i in range(episodes)]
    sampled = [_episode(policy, env, first_start + i, False) for i in range(episodes)]
    tested = [outcome.held for outcome in (*certain, *sampled) if outcome.held is not None]
    returns = np.mean([outcome.returns for outcome in certain], axis=0)
    return Evaluation(
        env_steps=env_steps,
        episodes=episodes,
        success_deterministic=float(np.mean([outcome.success for outcome in certain])),
        success_sampled=float(np.mean([outcome.success for outcome in sampled])),
        held_rate=float(np.mean(tested)) if tested else None,
        reversals_per_episode=float(np.mean([outcome.reversals for outcome in certain])),
        mean_final_stage=float(np.mean([outcome.final_stage for outcome in certain])),
        mean_length=float(np.mean([outcome.length for outcome in certain])),
        term_returns=dict(zip(env.reward_names, map(float, returns), strict=True)),
    )


def _episode(policy: Policy, env: StageTaskEnv, seed: int, deterministic: bool) -> _Outcome:
    obs, _ = env.reset(seed=seed, options={"stage": 1})
    returns, reversals, length = np.zeros(len(env.reward_names)), 0, 0
    over = False
    info: dict[str, Any] = {}
    while not over:
        action, _ = policy.predict(obs, deterministic=deterministic)
        obs, _, terminated, truncated, info = env.step(action)
        returns += info["vector_reward"]
        reversals += info["reversal"]
        length += 1
        over = terminated or truncated
    success = bool(info["is_success"])
    final_stage = env.task.n_stages + 1 if success else int(info["next_stage"])
    held = env.worlds.after_success(0) if success else None
    return _Outcome(success, held, reversals, final_stage, length, returns)
