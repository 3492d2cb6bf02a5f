"""FrankaKitchen in stages: open the microwave (1), move the kettle (2), turn on the light (3), open the cabinet (4).

The simulator's: the environment, its nine joint actions, how far an element is from its goal, and when it is done,
within 0.3. The environment crosses a sub-task off once it was done, in any order; here U(s) is the first of the four
that is not done now, so an oven that falls shut is one to open again. Ours: that order, the terms, starts that
differ, starts near a handle, and that the environment's noise of observation, which its control acts on, is off.
There is no expert.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.task import GymTask, Seen, Term, by_name, causal_sets

Array = NDArray[np.float64]


class Constants(NamedTuple):
    """Every number of the task."""

    done: float = 0.3  # of an element from its goal: the environment's
    per_metre: float = 10.0
    per_element: float = 10.0
    bonus: float = 2.0
    jitter: float = 0.05  # rad of each joint of the arm, either way, at a start
    ahead: float = 0.03  # m from a handle, where the hand starts in its stage
    around: float = 0.02  # m of each axis about that place


C = Constants()
JOINTS = ("j1", "j2", "j3", "j4", "j5", "j6", "j7")
ELEMENTS = ("microwave", "kettle", "light", "cabinet")
TERMS = (
    *(Term(f"r_to_{name}", (i,), True, "approach of the hand to the handle") for i, name in enumerate(ELEMENTS, 1)),
    *(Term(f"r_{name}", (i,), True, "approach of the element to its goal") for i, name in enumerate(ELEMENTS, 1)),
    Term("r_success", (1, 2, 3, 4), False, "bonus for a step into a later stage or to success"),
)
STATE_NAMES = (
    *(*JOINTS, "finger1", "finger2", "hand_x", "hand_y", "hand_z"),
    *(f"{name}_{axis}" for name in ELEMENTS for axis in "xyz"),
    *(f"{name}_lacks" for name in ELEMENTS),
)


def make() -> Any:
    """A new environment."""
    from causalbench_gymrob.kitchen import Kitchen

    return Kitchen(C.jitter)


def observe(seen: Seen) -> Array:
    """Joints, hand, its ways to the handles and what the elements lack (28,)."""
    return np.asarray(seen.observation)


def stage(seen: Seen) -> int:
    """U(s), from 1."""
    undone = np.flatnonzero(observe(seen)[24:] >= C.done)
    return int(undone[0]) + 1 if len(undone) else len(ELEMENTS)


def success(before: int, now: Seen) -> bool:
    """All four done, after a step from stage 4."""
    return before == len(ELEMENTS) and bool((observe(now)[24:] < C.done).all())


def _left(seen: Seen) -> Array:
    """What the terms pay for getting smaller (8,)."""
    state = observe(seen)
    ways = np.linalg.norm(state[12:24].reshape(4, 3), axis=1)
    return np.concatenate([C.per_metre * ways, C.per_element * state[24:]])


def rewards(before: Seen, was: int, action: Array, now: Seen, becomes: int) -> Array:
    """The terms (9,) of a step, each as if it belonged to every stage."""
    bonus = C.bonus * (becomes > was or success(was, now))
    return np.append(_left(before) - _left(now), bonus)


def reset_into(env: Any, rng: np.random.Generator, stage: int) -> Seen:
    """A start in `stage`."""
    from causalbench_gymrob import kitchen

    around = rng.uniform(-C.around, C.around, 3)
    return kitchen.put(env, int(rng.integers(2**31)), stage, around - [0.0, C.ahead, 0.0])


def snapshot(env: Any) -> bytes:
    """All of its state."""
    from causalbench_gymrob import kitchen

    return kitchen.snapshot(env)


def restore(env: Any, content: bytes) -> Seen:
    """The way back."""
    from causalbench_gymrob import kitchen

    return kitchen.restore(env, content)


TASK = GymTask(
    name="franka_kitchen",
    version=0,
    env_id="causalbench_gymrob/FrankaKitchen-v0",
    n_stages=4,
    actions=(*JOINTS, "finger1", "finger2"),
    terms=TERMS,
    state_names=STATE_NAMES,
    horizon=280,
    constants=by_name(C),
    manual_graph=causal_sets({
        i: {f"r_to_{name}": " ".join(JOINTS), f"r_{name}": " ".join(JOINTS)} for i, name in enumerate(ELEMENTS, 1)
    }),
    environments={"gymrob": make},
    stage=stage,
    success=success,
    rewards=rewards,
    observe=observe,
    state_bounds=(
        np.array([*[-3.2] * 7, -0.01, -0.01, -1.2, -0.8, 1.2, *[-2.0] * 12, *[-0.01] * 4]),
        np.array([*[3.9] * 7, 0.05, 0.05, 1.2, 1.2, 3.2, *[2.0] * 12, 1.0, 3.0, 1.5, 0.6]),
    ),
    snapshot=snapshot,
    restore=restore,
    exact_restore=True,
    reset_into=reset_into,
    modules=("gymnasium_robotics",),
)  # fmt: skip
