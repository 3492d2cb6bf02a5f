"""What agents see, and how far along they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.conformance.bench import expect
from causalbench.conformance.task_bench import TaskBench
from causalbench.core.tasks.stage_task import FEATURE_BOUND

WITHIN = 0.9  # share of the values of a state variable that must lie within its bounds
ROUNDING = 1e-6  # of the width of the bounds, which float32 and a product of rotations may be off


def _states(bench: TaskBench) -> NDArray[np.float64]:
    """(n, n_state) of every state that the walks come by."""
    return np.array([np.asarray(bench.task.observe(s.now), dtype=np.float64) for s in bench.samples])


def t19_state(bench: TaskBench) -> None:
    """T19. The state variables are finite and as many as their names, and observations lie in the observation space."""
    states = _states(bench)
    expect(
        states.shape[1:] == (len(bench.task.state_names),),
        f"observe() has the shape {states.shape[1:]} for {len(bench.task.state_names)} state_names",
    )
    wrong = [
        name for name, column in zip(bench.task.state_names, states.T, strict=True) if not np.isfinite(column).all()
    ]
    expect(
        not wrong, f"{', '.join(wrong)} are not finite in {int((~np.isfinite(states)).any(1).sum())} states of a walk"
    )
    space, found = bench.worlds.observation_space["state"], bench.worlds.observe()["state"]
    expect(space.contains(found), f"the observed state {found} lies outside {space}")


def t20_bounds(bench: TaskBench) -> None:
    """T20. On the walks 90% of the values of every state variable lie within `state_bounds`."""
    space, states = bench.worlds.observation_space["state"], _states(bench)
    low, high = space.low, space.high  # type: ignore[attr-defined]
    slack = ROUNDING * (high - low)
    outside = ((states < low - slack) | (states > high + slack)).mean(axis=0)
    wrong = {n: f"{share:.0%}" for n, share in zip(bench.task.state_names, outside, strict=True) if share > 1 - WITHIN}
    expect(not wrong, f"outside of state_bounds, where agents see only the bound, lie so many of the values: {wrong}")


def t21_features(bench: TaskBench) -> None:
    """T21. Features are finite and depend on the state alone: one by one, together or again, they are the same.

    Nor do they change the states that they are given, and each takes several values within +-5, where they are clipped.
    """
    states, task = _states(bench), bench.task
    kept = states.copy()
    together = np.asarray(task.features(states))
    expect(np.array_equal(states, kept, equal_nan=True), "features() changed the states that it was given")
    expect(
        together.shape == (len(states), len(task.feature_names)),
        f"features() of {states.shape} states has the shape {together.shape} for {len(task.feature_names)} names",
    )
    expect(np.isfinite(together).all(), f"{int((~np.isfinite(together)).any(1).sum())} rows of features are not finite")
    alone = np.array([task.features(state) for state in reversed(states)])[::-1]
    expect(
        np.allclose(alone, together, atol=1e-9), "features of a state differ when they are asked for alone, or again"
    )
    clipped = np.clip(together, -FEATURE_BOUND, FEATURE_BOUND)
    still = [name for name, column in zip(task.feature_names, clipped.T, strict=True) if np.ptp(column) == 0.0]
    expect(not still, f"{', '.join(still)} are constant on all walks, clipped to +-{FEATURE_BOUND:g}")


def t22_potential(bench: TaskBench) -> None:
    """T22. The potential is at least 0; a step into a later stage raises it, and one into an earlier stage lowers it.

    So a learner that climbs one reward gains nothing from falling back.
    """
    states, task = _states(bench), bench.task
    before = np.array([np.asarray(task.observe(s.before), dtype=np.float64) for s in bench.samples])
    was, becomes = (np.array([int(getattr(s.step, name)) for s in bench.samples]) for name in ("stage", "next_stage"))
    counts = np.isfinite(states).all(1) & np.isfinite(before).all(1) & (was >= 1) & (becomes >= 1)
    old, new = (np.asarray(task.potential(s[counts], u[counts])) for s, u in ((before, was), (states, becomes)))
    expect(np.isfinite(new).all() and (new >= 0.0).all(), f"the potential is {new.min():.3g} on a walk")
    moved = np.sign(becomes - was)[counts]
    wrong = np.flatnonzero((moved != 0) & (np.sign(new - old) != moved))
    expect(
        not len(wrong),
        f"{len(wrong)} steps into another stage change the potential the other way, such as from stage "
        f"{was[counts][wrong[:1]]} to {becomes[counts][wrong[:1]]}: {old[wrong[:1]]} to {new[wrong[:1]]}",
    )
