"""FetchPickAndPlace in stages: open above the block (1), lower the hand (2), close it (3), bring the block home (4).

The simulator's: the environment, its four actions and its success, a block within 5 cm of the goal, here after a step
from stage 4. Ours: stages, terms, the restored state, and that a start has a way to go. An action of 0 for `grip` keeps
the fingers where they are, but without force.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.task import GymTask, Seen, Term, by_name, causal_sets

Array = NDArray[np.float64]


class Constants(NamedTuple):
    """Every number of the task; metres."""

    hover: float = 0.08  # of the hand above the block, where stage 1 ends
    beside: float = 0.015  # of the hand off the block, each axis, in stages 2 and 3
    held: float = 0.03  # likewise, of a block that is held
    open: float = 0.07  # between the fingers, where stage 1 ends
    width: float = 0.053  # between the fingers around the block, which is 0.05 wide
    goal: float = 0.05  # of the block from its goal: the environment's
    way: float = 0.1  # of the block from its goal at a start, at least
    per_metre: float = 10.0
    bonus: float = 2.0
    gain: float = 15.0  # of the expert, 1/m


C = Constants()
ACTIONS = ("x", "y", "z", "grip")
TERMS = (
    Term("r_x", (1,), True, "approach of the hand to the block along x"),
    Term("r_y", (1,), True, "approach of the hand to the block along y"),
    Term("r_z1", (1,), True, "approach of the hand to the hover height"),
    Term("r_open", (1,), True, "opening of the fingers"),
    Term("r_z2", (2,), True, "approach of the hand to the block's height"),
    Term("r_close", (3,), True, "closing of the fingers"),
    Term("r_goalx", (4,), True, "approach of the block to its goal along x"),
    Term("r_goaly", (4,), True, "approach of the block to its goal along y"),
    Term("r_goalz", (4,), True, "approach of the block to its goal along z"),
    Term("r_success", (1, 2, 3, 4), False, "bonus for a step into a later stage or to success"),
)
STATE_NAMES = (
    *("hand_x", "hand_y", "hand_z", "block_x", "block_y", "block_z"),
    "fingers",
    "goal_x",
    "goal_y",
    "goal_z",
)


def make() -> Any:
    """A new environment, whose observation is that of the state after the step, not of the last substep's start."""
    from causalbench_gymrob.fresh import fresh

    return fresh("FetchPickAndPlace-v4", _has_a_way)


def _has_a_way(observation: Any) -> bool:
    """Whether the block is far from its goal: of the environment's starts, some are a success already."""
    return float(np.linalg.norm(observation["achieved_goal"] - observation["desired_goal"])) > C.way


def observe(seen: Seen) -> Array:
    """Hand, block, fingers and goal (10,)."""
    numbers = seen.observation["observation"]
    return np.concatenate([numbers[:6], [numbers[9] + numbers[10]], seen.observation["desired_goal"]])


def stage(seen: Seen) -> int:
    """U(s), from 1."""
    state = observe(seen)
    off, fingers = np.abs(state[3:6] - state[:3]), state[6]
    if (off < C.held).all() and fingers < C.width:
        return 4
    if (off < C.beside).all():
        return 3
    return 2 if (off[:2] < C.beside).all() and state[2] > state[5] and fingers > C.open else 1


def success(before: int, now: Seen) -> bool:
    """The environment's success, after a step from stage 4."""
    state = observe(now)
    return before == 4 and float(np.linalg.norm(state[3:6] - state[7:10])) < C.goal


def _left(seen: Seen) -> Array:
    """What the terms of progress pay for getting smaller (9,)."""
    state = observe(seen)
    x, y, z = state[:3] - state[3:6]
    to_open, to_close = max(C.open - state[6], 0.0), max(state[6] - C.width, 0.0)
    return np.abs([x, y, z - C.hover, to_open, z, to_close, *(state[3:6] - state[7:10])])


def rewards(before: Seen, was: int, action: Array, now: Seen, becomes: int) -> Array:
    """The terms (10,) of a step, each as if it belonged to every stage."""
    bonus = C.bonus * (becomes > was or success(was, now))
    return np.append(C.per_metre * (_left(before) - _left(now)), bonus)


def expert(seen: Seen) -> Array:
    """Proportional control of what the stage asks for."""
    state, u = observe(seen), stage(seen)
    way = state[7:10] - state[3:6] if u == 4 else state[3:6] - state[:3] + np.array([0.0, 0.0, C.hover * (u == 1)])
    return np.clip([*(C.gain * way), 1.0 if u <= 2 else -1.0], -1.0, 1.0)


def snapshot(env: Any) -> bytes:
    """All of its state."""
    from causalbench_gymrob import fresh

    return fresh.snapshot(env)


def restore(env: Any, content: bytes) -> Seen:
    """The way back."""
    from causalbench_gymrob import fresh

    return fresh.restore(env, content)


LOW, HIGH = np.array([1.0, 0.4, 0.38]), np.array([1.6, 1.1, 0.95])
TASK = GymTask(
    name="fetch_pick_and_place",
    version=0,
    env_id="causalbench_gymrob/FetchPickAndPlace-v0",
    n_stages=4,
    actions=ACTIONS,
    terms=TERMS,
    state_names=STATE_NAMES,
    horizon=100,
    constants=by_name(C),
    manual_graph=causal_sets({
        1: {"r_x": "x", "r_y": "y", "r_z1": "z", "r_open": "grip"},
        2: {"r_z2": "z"},
        3: {"r_close": "grip"},
        4: {"r_goalx": "x", "r_goaly": "y", "r_goalz": "z"},
    }),
    environments={"gymrob": make},
    stage=stage,
    success=success,
    rewards=rewards,
    observe=observe,
    state_bounds=(np.concatenate([LOW, LOW, [0.0], LOW]), np.concatenate([HIGH, HIGH, [0.11], HIGH])),
    snapshot=snapshot,
    restore=restore,
    exact_restore=True,
    expert=expert,
    modules=("gymnasium_robotics",),
)  # fmt: skip
