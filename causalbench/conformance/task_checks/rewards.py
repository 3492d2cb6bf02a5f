"""The vector of rewards."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.conformance.bench import expect
from causalbench.conformance.task_bench import Sample, TaskBench
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.tasks.stages import active_terms

VARIES = 1e-9  # least difference between the greatest and the smallest value of a term
ANTISYMMETRIC = 1e-6


def t14_inactive(bench: TaskBench) -> None:
    """T14. The vector is finite, and terms that do not belong to U(s) before the step are 0."""
    active = active_terms(bench.task.terms, bench.task.n_stages)
    for sample in bench.samples:
        paid, stage = sample.step.rewards, int(sample.step.stage)
        expect(paid.shape == (len(bench.task.terms),), f"rewards() has the shape {paid.shape}")
        expect(np.isfinite(paid).all(), f"rewards() said {paid} in stage {stage}")
        if stage in bench.stages:
            wrong = [
                name
                for name, on, value in zip(bench.task.term_names, active[stage], paid, strict=True)
                if value and not on
            ]
            expect(not wrong, f"in stage {stage}, {', '.join(wrong)} paid, which are not terms of it")


def t15_sum(bench: TaskBench) -> None:
    """T15. The scalar of a step is the sum of its vector, which is the caller's own: no later step changes it."""
    env, rng = StageTaskEnv(bench.worlds), np.random.default_rng(0)
    env.reset(seed=0)
    kept = []
    for _ in range(5):
        _, scalar, terminated, _, info = env.step(rng.uniform(-1.0, 1.0, len(bench.task.actions)).astype(np.float32))
        kept.append((scalar, info["vector_reward"]))
        if terminated:
            break
    wrong = [(scalar, vector) for scalar, vector in kept if not np.isclose(scalar, np.sum(vector), atol=1e-9)]
    expect(
        not wrong, f"a scalar is not the sum of its vector, (scalar, vector): {wrong[:1]}; return a new array each time"
    )


def t16_of_the_step(bench: TaskBench) -> None:
    """T16. Rewards depend on the step alone: computed again in reversed order, they are the same."""
    for sample in reversed(bench.samples):
        again = _paid(bench, sample)
        expect(
            np.array_equal(again, sample.step.rewards, equal_nan=True),
            f"a step of stage {sample.step.stage} was paid {sample.step.rewards}, and {again} when judged again",
        )


def _paid(bench: TaskBench, s: Sample) -> NDArray[np.float64]:
    """What the step is paid, terms outside its stage being 0."""
    paid = np.array(bench.task.rewards(s.before, s.step.stage, s.action, s.now, s.step.next_stage), dtype=np.float64)
    kept = s.step.rewards != 0.0
    outside = ~active_terms(bench.task.terms, bench.task.n_stages)[int(s.step.stage)]
    return np.where(outside & ~kept, 0.0, paid)


def t17_vary(bench: TaskBench) -> None:
    """T17. Every term that discovery may use varies in each of its stages, under random and scripted actions.

    Judged are the steps of the walks in that stage: a term that is constant there has no causes.
    """
    for stage in bench.starts:
        paid = np.array([s.step.rewards for s in bench.samples if int(s.step.stage) == stage])
        for name in bench.task.stage_terms(stage, discoverable_only=True):
            column = paid[:, bench.task.term_names.index(name)]
            expect(
                np.ptp(column) > VARIES,
                f"{name} is {column[0]:.3g} in each of {len(column)} steps in stage {stage}: it has no causes there",
            )


def t18_antisymmetric(bench: TaskBench) -> None:
    """T18. A progress term takes for a step back what it paid for the step forward: going back and forth gains nothing.

    Progress terms are those of `potential_terms` that discovery may use; steps count that stay in a stage.
    """
    names = [t.name for t in bench.task.terms if t.discoverable and t.name in bench.task.potential_terms]
    columns = [bench.task.term_names.index(name) for name in names]
    stay = [s for s in bench.samples if s.step.stage == s.step.next_stage and not s.step.success]
    there = [_paid(bench, s)[columns] for s in stay]
    back = [_paid(bench, Sample(s.now, -s.action, s.step, s.before))[columns] for s in stay]
    for s, paid, returned in zip(stay, there, back, strict=True):
        off = dict(zip(names, np.abs(paid + returned), strict=True))
        wrong = [name for name, value in off.items() if value > ANTISYMMETRIC]
        expect(
            not wrong, f"in stage {s.step.stage} a step and its reverse pay {paid} and {returned}: {', '.join(wrong)}"
        )
