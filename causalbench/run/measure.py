"""What the cells of a plan take on this machine, from trying one of each kind for a few seconds.

Seconds are those of a processor, so that what else runs now does not count; a cell, which steps in one thread, takes as
long on a core of its own.
"""

from __future__ import annotations

import dataclasses
import resource
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from causalbench.core.discovery.graph import manual_graph
from causalbench.digests import content_hash
from causalbench.errors import CausalbenchError, StoppedError
from causalbench.plugins.manager import installed
from causalbench.processes import call_in_spawned_process
from causalbench.run.cell import make_worlds_of, use_one_thread
from causalbench.store.cells import CHECKPOINT
from causalbench.suite.cells import Cell, DiscoveryCell, LearnerCell

if TYPE_CHECKING:
    from causalbench.core.learners.registry import TrainingProblem

SECONDS = 3.0
"""How long training, or a discovery, is tried."""
SMALL = 300_000.0
"""Bytes of a cell's tables, policy and log."""


@dataclass(frozen=True)
class Needs:
    """What a cell takes: seconds, bytes on the disk, and bytes of memory at its most."""

    seconds: float
    disk: float
    memory: float


def kind_of(cell: Cell) -> str:
    """What cells share that take about the same: all but the seed, and the seed's graph."""
    return content_hash({key: value for key, value in cell.identity.items() if key not in ("seed", "discovery")})


def measure(cells: Iterable[Cell], tell: Callable[[str], None]) -> dict[str, Needs]:
    """Id of a cell -> what it takes; cells of a kind that cannot be tried are missing. `tell` hears what is tried.

    Each kind has a process of its own, so that what simulators leave behind is not counted twice.
    """
    found: dict[str, Needs | None] = {}
    needs: dict[str, Needs] = {}
    for cell in cells:
        kind = kind_of(cell)
        if kind not in found:
            tell(f"trying {cell.id}")
            found[kind] = _tried(cell, tell)
        if known := found[kind]:
            needs[cell.id] = known
    return needs


def _tried(cell: Cell, tell: Callable[[str], None]) -> Needs | None:
    try:
        return call_in_spawned_process(_try, cell)
    except Exception as error:  # a stranger's simulator: its run would say the same, so a plan is no place to stop
        tell(f"{cell.id} cannot be tried: {error}")
        return None


def _try(cell: Cell) -> Needs:
    """What a process of its own does."""
    use_one_thread()
    with TemporaryDirectory(prefix="causalbench-plan-") as folder:
        seconds, disk = (
            _try_discovery(cell) if isinstance(cell, DiscoveryCell) else _try_learner(cell, Path(folder) / CHECKPOINT)
        )
    unit = 1 if sys.platform == "darwin" else 1024
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    return Needs(seconds, disk + SMALL, most + disk)


class _EnoughError(CausalbenchError):
    """Ends a trial."""


class _Clock:
    """Notes when which share was done, and ends the trial after `SECONDS`."""

    def __init__(self) -> None:
        self.times: list[tuple[float, float]] = []

    def __call__(self, share: float, text: str) -> None:
        self.times.append((time.process_time(), share))
        if self.elapsed() > SECONDS:
            raise _EnoughError

    def elapsed(self) -> float:
        """Seconds since the first note."""
        return time.process_time() - self.times[0][0] if self.times else 0.0

    def seconds(self) -> float:
        """Seconds that the whole would take at the speed of the second half of the trial."""
        (start, _), (end, done) = self.times[0], self.times[-1]
        then, share = next(one for one in self.times if one[0] >= (start + end) / 2)
        if (end, done) == (then, share):
            then, share = self.times[0]
        return (end - then) / (done - share) if done > share else 0.0


def _try_discovery(cell: DiscoveryCell) -> tuple[float, float]:
    from causalbench.core.discovery.pipeline import discover

    task, clock = installed().task(cell.task.name), _Clock()
    try:
        make = make_worlds_of(cell.backend, task)
        discover(task, make, cell.settings, cell.seed, clock, discoverers=installed().discoverers)
    except _EnoughError:
        return clock.seconds(), 0.0
    return clock.times[-1][0] - clock.times[0][0], 0.0


def _try_learner(cell: LearnerCell, checkpoint: Path) -> tuple[float, float]:
    """Seconds and bytes: of making the worlds, of each step of training, of each evaluation as if nothing succeeded."""
    clock, first = _Clock(), _Clock()
    began = time.process_time()
    _train(cell, dataclasses.replace(_problem(cell, checkpoint, first), env_steps=1))
    ended, stepped = time.process_time(), first.times[-1][0]
    small, start = _size(checkpoint), stepped - began
    checkpoint.unlink(missing_ok=True)
    _train(cell, _problem(cell, checkpoint, clock))
    taken = max(1.0, clock.times[-1][1] * cell.env_steps)
    growth = max(0.0, _size(checkpoint) - small) / taken * cell.env_steps
    looks = _episode_batches(cell) * (ended - stepped) / 2  # one episode by sampled actions, one without
    return start + clock.seconds() + looks, small + growth


def _problem(cell: LearnerCell, checkpoint: Path, clock: _Clock) -> TrainingProblem:
    """Training of `cell` that learns from the first steps on, and is evaluated at its end by one episode.

    On the human's graph, since there is none yet. It stops itself, where it can, to leave a checkpoint.
    """
    from causalbench.core.learners.checkpoint import Checkpoints
    from causalbench.core.learners.registry import TrainingProblem

    task = installed().task(cell.task.name)
    late = {"learning_starts": 1, "n_steps": 8}  # setting -> batches that it shrinks to
    given: dict[str, Any] = dataclasses.asdict(cell.learner)
    sooner = {key: min(given[key], n * given["batch_size"]) for key, n in late.items() if key in given}
    return TrainingProblem(
        task=task,
        make_worlds=make_worlds_of(cell.backend, task),
        method=cell.method,
        graph=None if cell.method.matrix == "none" else manual_graph(task),
        settings=dataclasses.replace(cell.learner, **sooner),
        evaluation=dataclasses.replace(cell.evaluation, every=2 * cell.env_steps, episodes=1, final_episodes=1),
        env_steps=cell.env_steps,
        seed=cell.seed,
        on_evaluation=lambda found, counts: None,
        on_progress=clock,
        checkpoints=Checkpoints(checkpoint, 2 * cell.env_steps, lambda: clock.elapsed() > 0.9 * SECONDS),
    )


def _train(cell: LearnerCell, problem: TrainingProblem) -> None:
    with suppress(_EnoughError, StoppedError):
        installed().learner(cell.method.learner).train(problem)


def _episode_batches(cell: LearnerCell) -> int:
    """How many episodes, or batches of them that step together, all evaluations of `cell` play, each to its end."""
    from causalbench.core.learners.examiner import MOST_WORLDS

    task, settings = installed().task(cell.task.name), cell.evaluation
    with closing(make_worlds_of(cell.backend, task)(1)) as worlds:
        together = MOST_WORLDS if worlds.steps_as_one else 1
    looks = (cell.env_steps - 1) // settings.every
    return looks * -(-settings.episodes // together) + 2 * -(-settings.final_episodes // together)


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0
