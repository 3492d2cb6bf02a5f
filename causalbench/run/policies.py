"""Finished policies of a run, each with a world to act in: what films and the account of reversals start from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from causalbench.core.learners.policy import load_policy
from causalbench.core.learners.registry import Policy
from causalbench.core.learners.settings import observed
from causalbench.core.staged.env import StageTaskEnv
from causalbench.errors import UserError
from causalbench.plugins.manager import installed
from causalbench.plugins.venues import worlds_maker
from causalbench.store.cells import StoredCell
from causalbench.store.run_folder import RunFolder
from causalbench.suite.selection import Selection


class Trained(NamedTuple):
    """A policy in a world like those that it was examined in; start i of evaluations has the seed `first_start` + i."""

    policy: Policy
    env: StageTaskEnv
    first_start: int


def finished(run: RunFolder, only: Sequence[str]) -> list[StoredCell]:
    """The cells of finished policies that `only` keeps. Raises `UserError` if there are none."""
    selection = Selection.parse(only)
    cells = [cell for cell in run.cells() if cell.is_done("learner") and selection.keeps(cell.identity)]
    if not cells:
        raise UserError(f"{run.path}: no finished policy here, or none that --only keeps")
    return cells


@contextmanager
def trained(cell: StoredCell, place: Mapping[str, Any] | None = None) -> Iterator[Trained]:
    """The policy of `cell` in a world of its own, which is closed in the end.

    `place` is the identity of another backend to play on; None for the one of its training.
    """
    identity = cell.identity
    backend = place or identity["backend"]
    load = installed().learner(identity["method"]["learner"]).load_policy or load_policy
    policy, task = load(cell.policy_folder()), installed().task(cell.task)
    make_worlds = worlds_maker(installed().backend(backend["name"]), task, backend["options"])
    env = StageTaskEnv(make_worlds(), None, *observed(identity["learner"]).values())
    try:
        yield Trained(policy, env, identity["evaluation"]["first_start"])
    finally:
        env.close()
