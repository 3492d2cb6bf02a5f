"""Runs one cell in this process. torch and a simulator are imported here and nowhere above."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from causalbench.atomic import write_folder, write_text
from causalbench.core.discovery.graph import CausalGraph, manual_graph
from causalbench.core.learners.records import Evaluation, TrainingCounts
from causalbench.core.tasks.stage_task import StageTask, base_name
from causalbench.digests import source_hash
from causalbench.errors import CausalbenchError, CheckpointError, DivergedError, StoppedError
from causalbench.plugins.manager import Plugins, installed
from causalbench.plugins.venues import worlds_maker
from causalbench.run.score_graph import judge_graph
from causalbench.run.tensorboard import Board
from causalbench.store.cell_progress import ProgressFile
from causalbench.store.cells import CHECKPOINT, DATA, LOG, State, Status
from causalbench.store.episodes import write_episodes
from causalbench.store.records import write_counts, write_progress
from causalbench.store.run_folder import RunFolder
from causalbench.store.samples import SampleFolder
from causalbench.suite.cells import BackendIdentity, Cell, DiscoveryCell, LearnerCell

if TYPE_CHECKING:
    from causalbench.core.learners.registry import Learner, Trained, TrainingProblem
    from causalbench.core.staged.worlds import MakeWorlds


@dataclass(frozen=True)
class Progress:
    """How far a cell is: a share in [0, 1], what it does, and its latest figures if it has any."""

    fraction: float
    text: str
    success: float | None = None
    reversals_per_1000_steps: float | None = None


OnProgress = Callable[[Progress], None]
StopAsked = Callable[[], bool]

LOGGER = logging.getLogger("causalbench")


@dataclass(frozen=True)
class Keeping:
    """What a learner cell keeps beside its results, none of which it changes."""

    checkpoint_every: int = 2_000  # env steps
    tensorboard: bool = False


def run_cell(
    cell: Cell, run: RunFolder, on_progress: OnProgress, keeping: Keeping, cores: int = 1,
    stop_asked: StopAsked = lambda: False,
) -> Status:  # fmt: skip
    """Run `cell`, which `run.start` has prepared, fill its folder and return its status; it may use `cores`.

    An error becomes the status; its traceback goes to `log.txt`. Raises `StoppedError` when `stop_asked()` and the
    learner has kept a checkpoint; the cell then stays "running", to be continued.
    """
    folder = run.folder(cell)
    started = time.monotonic()
    with _logging_to(folder / LOG), closing(ProgressFile(folder)) as kept:
        tell = _telling(kept, on_progress)
        try:
            use_one_thread()
            if isinstance(cell, DiscoveryCell):
                steps = _discover(cell, folder, tell, cores)
            else:
                steps = _learn(cell, folder, run, tell, keeping, stop_asked)
            status = Status("done", "", time.monotonic() - started, steps, source_of(cell, installed()))
        except StoppedError as error:
            LOGGER.info("%s", error)
            raise
        except (Exception, SystemExit) as error:  # a simulator that exits ends its cell, not the run
            LOGGER.exception("the cell ends here")
            kind = "" if isinstance(error, CausalbenchError) else f"{type(error).__name__}: "
            state: State = "diverged" if isinstance(error, DivergedError) else "failed"
            status = Status(state, f"{kind}{error}", time.monotonic() - started)
    run.finish(cell, status)
    return status


def _telling(kept: ProgressFile, on_progress: OnProgress) -> OnProgress:
    """`on_progress`, and the cell's file for whoever watches from elsewhere."""

    def tell(progress: Progress) -> None:
        kept.write(progress.fraction, progress.text)
        on_progress(progress)

    return tell


def source_of(cell: Cell, plugins: Plugins) -> str:
    """`package=hash` of each package whose source code is behind `cell`, with spaces between.

    Those are causalbench and the plugins that registered its task, backend, discoverer, method and learner.
    """
    used = {("tasks", base_name(cell.task.name)), ("backends", cell.backend.name)}
    if isinstance(cell, LearnerCell):
        used |= {("methods", cell.method.name), ("learners", cell.method.learner)}
    discovery = cell.discovery if isinstance(cell, LearnerCell) else cell
    if discovery:
        used.add(("discoverers", discovery.settings.discoverer))
    packages = {"causalbench"} | {plugins.packages[one] for one in used}
    return " ".join(f"{package}={source_hash(package)}" for package in sorted(packages))


@contextmanager
def _logging_to(path: Path) -> Iterator[None]:
    """Append what causalbench logs to `path`."""
    handler = logging.FileHandler(path, encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(message)s", "%H:%M:%S"))
    level = LOGGER.level
    LOGGER.addHandler(handler)
    LOGGER.setLevel(logging.INFO)
    try:
        yield
    finally:
        LOGGER.removeHandler(handler)
        LOGGER.setLevel(level)
        handler.close()


def use_one_thread() -> None:
    """One torch thread: several cells share the machine, and the order of sums must not depend on its cores."""
    import torch

    torch.set_num_threads(1)


def make_worlds_of(backend: BackendIdentity, task: StageTask) -> MakeWorlds:
    """A function that makes new worlds of `task` in the backend, with the suite's options."""
    return worlds_maker(installed().backend(backend.name), task, backend.options)


def _discover(cell: DiscoveryCell, folder: Path, on_progress: OnProgress, cores: int) -> int:
    from causalbench.core.discovery.pipeline import discover

    task = installed().task(cell.task.name)
    graph = discover(
        task,
        make_worlds_of(cell.backend, task),
        cell.settings,
        cell.seed,
        lambda share, text: on_progress(Progress(share, text)),
        discoverers=installed().discoverers,
        cores=cores,
        store=SampleFolder(folder / DATA),
    )
    if cell.settings.oracle_states:
        graph, _ = judge_graph(
            graph, task, make_worlds_of(cell.backend, task), cell.settings.oracle_states, cell.seed, folder,
            lambda share, text: on_progress(Progress(share, text)),
        )  # fmt: skip
    write_graph(folder, graph, manual_graph(task))
    return graph.env_steps


def write_graph(folder: Path, graph: CausalGraph, human: CausalGraph) -> None:
    """Write `graph.json`, the human's as `manual.json`, and the numbers behind it as `evidence.csv`."""
    from causalbench.core.discovery.tables import evidence_table

    write_text(folder / "evidence.csv", evidence_table(graph).to_csv(index=False, lineterminator="\n"))
    write_text(folder / "manual.json", human.to_json() + "\n")
    write_text(folder / "graph.json", graph.to_json() + "\n")


def _learn(
    cell: LearnerCell, folder: Path, run: RunFolder, on_progress: OnProgress, keeping: Keeping, stop_asked: StopAsked
) -> int:
    from causalbench.core.learners.checkpoint import Checkpoints
    from causalbench.core.learners.registry import TrainingProblem

    task = installed().task(cell.task.name)
    with closing(_Watcher(folder, on_progress, keeping.tensorboard)) as watcher:
        problem = TrainingProblem(
            task=task,
            make_worlds=make_worlds_of(cell.backend, task),
            method=cell.method,
            graph=_graph(cell, task, run),
            settings=cell.learner,
            evaluation=cell.evaluation,
            env_steps=cell.env_steps,
            seed=cell.seed,
            on_evaluation=watcher.on_evaluation,
            on_progress=watcher.on_progress,
            checkpoints=Checkpoints(folder / CHECKPOINT, keeping.checkpoint_every, stop_asked),
        )
        policy, counts = _train(installed().learner(cell.method.learner), problem)
        write_episodes(folder / "episodes.csv", watcher.evaluations[-1].played)
    write_counts(folder / "counts.json", counts, problem.graph)
    write_folder(folder / "policy", policy.save)
    return counts.env_steps


def _train(learner: Learner, problem: TrainingProblem) -> Trained:
    """Train, from the start where the checkpoint is damaged or of another run: a cell must not fail for ever."""
    try:
        return learner.train(problem)
    except CheckpointError as error:
        LOGGER.warning("%s. It is deleted: the cell starts over", error)
        assert problem.checkpoints is not None
        problem.checkpoints.path.unlink()
        return learner.train(problem)


def _graph(cell: LearnerCell, task: StageTask, run: RunFolder) -> CausalGraph | None:
    from causalbench.core.learners.training_graph import training_graph

    found = None
    if cell.discovery is not None:
        found = replace(run.stored(cell.discovery).graph(), task=task.name)  # which may be another task's
    graph = training_graph(task, cell.method, found, make_worlds_of(cell.backend, task), cell.seed, cell.action_repeat)
    if graph is not None and graph.origin in ("oracle", "control"):
        write_text(run.folder(cell) / "graph.json", graph.to_json() + "\n")
    return graph


class _Watcher:
    """Keeps the evaluations of one training run on disk and its latest figures in view."""

    def __init__(self, folder: Path, on_progress: OnProgress, tensorboard: bool) -> None:
        self.folder, self.report = folder, on_progress
        self.board = Board(folder / "tensorboard") if tensorboard else None
        self.evaluations: list[Evaluation] = []
        self.success: float | None = None
        self.reversals: float | None = None

    def on_evaluation(self, evaluation: Evaluation, counts: TrainingCounts) -> None:
        """Write the evaluation to `progress.csv` and log it."""
        self.evaluations.append(evaluation)
        write_progress(self.folder / "progress.csv", self.evaluations)
        if self.board:
            self.board.add(evaluation)
        self.success = evaluation.success_deterministic
        self.reversals = 1000 * counts.reversals / max(counts.env_steps, 1)
        LOGGER.info(
            "step %d: success %.2f, final stage %.2f", evaluation.env_steps, self.success, evaluation.mean_final_stage
        )

    def on_progress(self, fraction: float, text: str) -> None:
        """Hand on how far training is."""
        self.report(Progress(fraction, text, self.success, self.reversals))

    def close(self) -> None:
        """End the TensorBoard files, if there are any."""
        if self.board:
            self.board.close()
