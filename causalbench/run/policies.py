"""Finished policies of a run, each with a world to act in: what films and the account of reversals start from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from typing import Any, NamedTuple

from causalbench.core.learners.policy import load_policy
from causalbench.core.learners.registry import Policy
from causalbench.core.learners.settings import observed
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.worlds import MakeWorlds, Worlds
from causalbench.errors import UserError
from causalbench.plugins.manager import installed
from causalbench.plugins.venues import worlds_maker
from causalbench.store.cells import StoredCell
from causalbench.store.run_folder import RunFolder
from causalbench.suite.selection import Selection


class Trained(NamedTuple):
    """A policy with worlds that observe what it reads; start i of evaluations has the seed `first_start` + i."""

    policy: Policy
    make_worlds: MakeWorlds
    observed: Mapping[str, Any]
    first_start: int

    @contextmanager
    def env(self) -> Iterator[StageTaskEnv]:
        """One world as an environment, which is closed in the end."""
        with closing(StageTaskEnv(self.make_worlds(), None, *self.observed.values())) as env:
            yield env

    @contextmanager
    def worlds(self, n: int) -> Iterator[Worlds]:
        """Worlds of shape (n,), which are closed in the end."""
        with closing(self.make_worlds(n)) as worlds:
            worlds.choose_observation(*self.observed.values())
            yield worlds


def finished(run: RunFolder, only: Sequence[str]) -> list[StoredCell]:
    """The cells of finished policies that `only` keeps. Raises `UserError` if there are none."""
    selection = Selection.parse(only)
    cells = [cell for cell in run.cells() if cell.is_done("learner") and selection.keeps(cell.identity)]
    if not cells:
        raise UserError(f"{run.path}: no finished policy here, or none that --only keeps")
    return cells


def trained(cell: StoredCell, place: Mapping[str, Any] | None = None) -> Trained:
    """The policy of `cell`, to be played on the backend with the identity `place`, or on its own for None."""
    identity = cell.identity
    backend = place or identity["backend"]
    load = installed().learner(identity["method"]["learner"]).load_policy or load_policy
    make_worlds = worlds_maker(installed().backend(backend["name"]), installed().task(cell.task), backend["options"])
    first_start = identity["evaluation"]["first_start"]
    return Trained(load(cell.policy_folder()), make_worlds, observed(identity["learner"]), first_start)
