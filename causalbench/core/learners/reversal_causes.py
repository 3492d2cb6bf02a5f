"""Whose doing is a reversal? The step that led to it, taken again from before it without some of its actions.

The paper's story is that actions which cause none of a stage's rewards undo what earlier stages reached. So every step
that fell back is taken again, from a snapshot, once with these redundant actions at 0 and once with the causes at 0: a
reversal that does not come without an action group was that group's doing, alone or together with the other.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from causalbench.core.learners.records import ReversalCauses
from causalbench.core.learners.registry import Policy
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.worlds import Worlds
from causalbench.core.world.capabilities import Capability

Mask = NDArray[np.bool_]


def reversal_causes(
    policy: Policy, env: StageTaskEnv, causes: Mask, episode: int, seed: int, deterministic: bool
) -> Iterator[ReversalCauses]:
    """One episode of `policy` from stage 1, whose start has the seed `seed`; a row for each stage that it was in.

    `causes` (n_stages, n_actions) says which actions cause a reward of which stage. Raises `UserError` unless the
    worlds restore exactly.
    """
    env.worlds.require(Capability.EXACT_RESTORE, "taking a step again")
    n_stages = len(causes)
    steps, found = np.zeros(n_stages, np.int64), np.zeros((n_stages, 4), np.int64)
    obs, _ = env.reset(seed=seed, options={"stage": 1})
    over = False
    while not over:
        before = env.worlds.snapshot(0)
        action, _ = policy.predict(obs, deterministic=deterministic)
        obs, _, terminated, truncated, info = env.step(action)
        over, stage = terminated or truncated, info["stage"] - 1
        steps[stage] += 1
        if info["reversal"]:
            found[stage] += [1, *_taken_again(env.worlds, before, action, causes[stage])]
    for stage in np.flatnonzero(steps):
        reversals, repeated, without_redundant, without_causes = map(int, found[stage])
        yield ReversalCauses(
            episode, deterministic, int(stage) + 1, int(steps[stage]), reversals, repeated, without_redundant,
            without_causes,
        )  # fmt: skip


def _taken_again(worlds: Worlds, before: bytes, action: NDArray[np.float32], causes: Mask) -> tuple[bool, bool, bool]:
    """Whether the reversal comes again unchanged, vanishes without redundant actions, vanishes without causes."""
    after = worlds.snapshot(0)
    comes = []
    for kept in (np.ones_like(causes), causes, ~causes):
        worlds.restore([0], [before])
        comes.append(bool(worlds.step(np.where(kept, action, 0.0)).reversal))
    worlds.restore([0], [after])
    unchanged, without_redundant, without_causes = comes
    return unchanged, not without_redundant, not without_causes
