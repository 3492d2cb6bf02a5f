"""U(s), and starts inside the stages."""

from __future__ import annotations

import numpy as np

from causalbench.conformance.bench import expect
from causalbench.conformance.task_bench import TaskBench


def t06_total(bench: TaskBench) -> None:
    """T6. U(s) is a stage from 1 to `n_stages` in every state of the walks."""
    wrong = {int(s.step.next_stage) for s in bench.samples} - {*bench.stages}
    expect(not wrong, f"stage() said {sorted(wrong)}, expected 1 to {bench.task.n_stages} in every state")


def t07_memoryless(bench: TaskBench) -> None:
    """T7. U(s) depends on the state alone: computed again in reversed order, it gives the same stages.

    What latches, such as "has been above it once", is no state.
    """
    for sample in reversed(bench.samples):
        again, first = int(bench.task.stage(sample.now)), int(sample.step.next_stage)
        expect(again == first, f"stage() said {first} of a state on a walk, and {again} when asked of it again")


def t08_entered(bench: TaskBench) -> None:
    """T8. A reset can start in every stage, and U(s) is then that stage (3 starts each)."""
    expect(not bench.refused, " ".join(f"Stage {stage}: {reason}." for stage, reason in bench.refused.items()))
    for stage, starts in bench.starts.items():
        found = [int(bench.task.stage(start)) for start in starts]
        expect(found == [stage] * len(starts), f"starts of stage {stage} lie in the stages {found}")


def t09_starts_differ(bench: TaskBench) -> None:
    """T9. Starts in a stage differ from seed to seed."""
    for stage, starts in bench.starts.items():
        states = [np.asarray(bench.task.observe(start)) for start in starts]
        expect(
            len(states) < 2 or not all(np.array_equal(states[0], other, equal_nan=True) for other in states[1:]),
            f"starts of stage {stage} from {len(states)} seeds are all the same: draw from the generator that is given",
        )
