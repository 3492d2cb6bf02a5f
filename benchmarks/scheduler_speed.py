"""What the scheduler of a run costs beside its cells: 1,000 that take no time, a plan of 10,000, 64 simulated cores.

    python benchmarks/scheduler_speed.py

Cells do nothing but write their folder; what is measured is the runner: processor time and memory a cell, and how well
64 simulated cores are used by one runner that needs so much time a cell.
"""

from __future__ import annotations

import heapq
import resource
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from causalbench.plugins.manager import installed
from causalbench.run.executors.schedule import schedule
from causalbench.store.cells import Status
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import Cell
from causalbench.suite.plan import Plan, make_plan
from causalbench.suite.schema import load_suite

SUITE = """\
schema: 1
name: many
task: pure_manipulation
backends: [kinematic]
methods: [mSAC, cSAC]
tiers:
  quick: {seeds: SEEDS, env_steps: 20_000}
"""


class Idle:
    """An executor whose cells are over as soon as they have begun."""

    jobs = 2

    def __init__(self, run: RunFolder) -> None:
        self.run, self._over = run, list[Cell]()

    def free(self) -> int:
        """What no cell has."""
        return self.jobs - len(self._over)

    def start(self, cell: Cell) -> None:
        """Begin it and end it."""
        self.run.start(cell)
        self.run.finish(cell, Status("diverged", "nothing was done"))
        self._over.append(cell)

    def ended(self) -> Sequence[Cell]:
        """All that began."""
        over, self._over = self._over, []
        return over

    def stop(self) -> None:
        """Nothing runs."""


def plan_of(folder: Path, cells: int) -> Plan:
    """A plan of so many cells."""
    path = folder / f"{cells}.yaml"
    path.write_text(SUITE.replace("SEEDS", str(cells // 2)))
    return make_plan(load_suite(path, installed()), "quick", installed())


def memory() -> float:
    """Highest resident memory of this process so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def used(cores: int, cell_seconds: float, runner_seconds: float, cells: int) -> float:
    """Share of the time of `cores` that work, if one runner spends `runner_seconds` on each cell, one after another."""
    ends: list[float] = []
    runner = 0.0
    for _ in range(cells):
        free_at = heapq.heappop(ends) if len(ends) == cores else 0.0
        runner = max(runner, free_at) + runner_seconds
        heapq.heappush(ends, runner + cell_seconds)
    return cells * cell_seconds / (cores * max(ends))


def main() -> None:
    """Print the figures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        installed()
        begin = time.process_time()
        plan_of(folder, 10_000)
        print(f"plan of 10,000 cells: {time.process_time() - begin:.2f} s")
        plan, run = plan_of(folder, 1_000), RunFolder(folder / "run")
        before, begin, marks = memory(), time.process_time(), []
        with run.claim():
            for number, _ in enumerate(schedule(plan.cells, run, Idle(run)), start=1):
                if number % 250 == 0:
                    marks.append(memory())
        cost = (time.process_time() - begin) / len(plan.cells)
        print(f"1,000 cells: {1000 * cost:.2f} ms of processor time each; memory {before:.0f} MB before, then {marks}")
        for seconds in (10.0, 60.0, 600.0):
            share = used(64, seconds, cost, 6_400)
            print(f"64 cores, cells of {seconds:.0f} s: {100 * share:.1f}% of linear")


if __name__ == "__main__":
    main()
