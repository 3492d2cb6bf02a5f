"""The same again: from the same seed, beside another world, from a snapshot."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.conformance.bench import expect
from causalbench.conformance.task_bench import Sample, TaskBench, take
from causalbench.core.world.capabilities import Capability
from causalbench.core.world.facts import Facts

Array = NDArray[np.float64]

DECIMALS = 6  # of what is compared: the last bits of another processor, or of a batch, are no difference
RESTORED_STEPS = 5
RESTORED_SHARE = 0.01  # of the width of a state's bounds, that a world may be off after an inexact restore


def rows(bench: TaskBench, samples: Sequence[Sample], decimals: int | None = DECIMALS) -> Array:
    """Stages, rewards, success and states of `samples`, a row each."""
    found = [
        [*s.step.rewards, s.step.next_stage, s.step.success, *np.ravel(bench.task.observe(s.now))] for s in samples
    ]
    table = np.array(found, dtype=np.float64)
    return table if decimals is None else np.round(table, decimals)


def difference(a: Array, b: Array) -> str:
    """By how much two tables differ, and from which step on."""
    if a.shape != b.shape:
        return f"and ends after {len(b)} steps, not {len(a)}"
    first = int((~np.isclose(a, b, atol=0.0, rtol=0.0, equal_nan=True)).any(axis=1).argmax())
    return f"by {np.nanmax(np.abs(a - b)):.2g} at most, first at step {first + 1}"


def repeatable(bench: TaskBench) -> bool:
    """Whether a walk is the same when it is taken again: if not, T10 says so, and nothing else needs to."""
    stage = min(bench.starts, default=0)
    if not stage:
        return True
    first, second = (rows(bench, bench.walk(stage, 0)) for _ in range(2))
    return np.array_equal(first, second, equal_nan=True)


def t10_deterministic(bench: TaskBench) -> None:
    """T10. The same seeds and actions give the same results, to the bit, in other worlds and after other episodes."""
    other = bench.make()
    for stage in reversed(bench.starts):
        first, second, third = (
            rows(bench, bench.walk(stage, 1, worlds), decimals=None) for worlds in (bench.worlds, other, bench.worlds)
        )
        for again, where in ((second, "in other worlds"), (third, "once more")):
            expect(
                np.array_equal(first, again, equal_nan=True),
                f"a walk from stage {stage}, {where}, goes otherwise {difference(first, again)}",
            )


def t11_together(bench: TaskBench) -> None:
    """T11. Worlds that step together do what each does alone, to six decimals.

    Functions of a `Task` take one world's facts or those of several, with a leading dimension.
    """
    if not bench.starts or not repeatable(bench):
        return
    stage = min(bench.starts)
    pair, rng = bench.make(2), np.random.default_rng(0)
    alone = [_walked(bench, stage, seed) for seed in (0, 1)]
    pair.reset([0, 1], [np.random.default_rng(seed) for seed in (0, 1)], stage)
    for count in range(len(alone[0])):
        step = pair.step(np.stack([rng.uniform(-1.0, 1.0, len(bench.task.actions))] * 2))
        for world, walk in enumerate(alone):
            if count >= len(walk):
                continue
            expected, found = walk[count].step, [np.asarray(field)[world] for field in step]
            same = all(
                np.allclose(a, b, atol=10.0**-DECIMALS, equal_nan=True) for a, b in zip(expected, found, strict=True)
            )
            expect(same, f"two worlds that step together: {found}, and alone: {list(expected)} (step {count + 1})")


def _walked(bench: TaskBench, stage: int, seed: int) -> list[Sample]:
    """A walk of random actions, the same for every start."""
    bench.worlds.reset([0], [np.random.default_rng(seed)], stage)
    rng, found = np.random.default_rng(0), []
    for _ in range(RESTORED_STEPS):
        found.append(take(bench.worlds, rng.uniform(-1.0, 1.0, len(bench.task.actions))))
        if found[-1].step.terminated:
            break
    return found


def t12_restored(bench: TaskBench) -> None:
    """T12. From a snapshot a world continues as it did before, to the bit with `EXACT_RESTORE`.

    Without it no state variable may be off by more than 1% of the width of its bounds in 5 steps.
    """
    worlds = bench.worlds
    for stage in bench.starts:
        worlds.reset([0], [np.random.default_rng(2)], stage)
        snapshot, first = worlds.snapshot(0), _states(bench)
        worlds.reset([0], [np.random.default_rng(3)], stage)
        worlds.restore([0], [snapshot])
        off = np.nan_to_num(np.abs(_states(bench) - first)).max()
        if Capability.EXACT_RESTORE in worlds.capabilities:
            expect(off == 0.0, f"restored in stage {stage}, states go on otherwise, by up to {off:.2g} of their bounds")
        expect(off <= RESTORED_SHARE, f"restored in stage {stage}, states are off by {off:.2g} of their bounds")


def _states(bench: TaskBench) -> Array:
    """States now and in a few random steps, as shares of the width of their bounds."""
    rng, worlds = np.random.default_rng(4), bench.worlds
    low, high = worlds.observation_space["state"].low, worlds.observation_space["state"].high  # type: ignore[attr-defined]
    found = [bench.task.observe(bench.seen())]
    for _ in range(RESTORED_STEPS):
        now = take(worlds, rng.uniform(-1.0, 1.0, len(bench.task.actions)))
        found.append(bench.task.observe(now.now))
        if now.step.terminated:
            break
    rest = [found[-1]] * (RESTORED_STEPS + 1 - len(found))
    return np.array([*found, *rest], dtype=np.float64) / (high - low)


def t13_pure(bench: TaskBench) -> None:
    """T13. The task's functions change none of their arguments, neither what is seen nor the action."""
    for sample in bench.samples[:: max(1, len(bench.samples) // 20)]:
        kept = copy.deepcopy((_arrays(sample.before), sample.action, _arrays(sample.now)))
        for name, call in _calls(bench, sample).items():
            call()
            now = _arrays(sample.before), sample.action, _arrays(sample.now)
            expect(_same(kept, now), f"{name}() changed what it was given: work on a copy")


def _calls(bench: TaskBench, sample: Sample) -> dict[str, Any]:
    task, step = bench.task, sample.step
    calls = {
        "stage": lambda: task.stage(sample.now),
        "observe": lambda: task.observe(sample.now),
        "success": lambda: task.success(step.stage, sample.now),
        "rewards": lambda: task.rewards(sample.before, step.stage, sample.action, sample.now, step.next_stage),
    }
    if Capability.EXPERT in bench.worlds.capabilities:
        calls["expert"] = lambda: scripted(bench, sample.now)
    return calls


def scripted(bench: TaskBench, seen: Any) -> Array:
    """What the expert says of what is seen; without a map."""
    found: Array = bench.task.expert(seen, bench.worlds.spec) if isinstance(seen, Facts) else bench.task.expert(seen)  # type: ignore[attr-defined]
    return found


def _arrays(seen: Any) -> Any:
    """What the functions read, as plain data."""
    if isinstance(seen, Facts):
        found = {field.name: getattr(seen, field.name) for field in dataclasses.fields(seen)}
        return found | {"extras": dict(seen.extras)}
    return seen.observation


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return all(_same(a[name], b[name]) for name in a)
    if isinstance(a, tuple | list):
        return all(map(_same, a, b))
    return bool(np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind == "f"))
