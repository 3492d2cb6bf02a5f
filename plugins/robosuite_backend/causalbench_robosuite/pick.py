"""What robosuite's tasks that pick a thing up and put it elsewhere share, in six stages.

After those of `approach` lift and carry (4), lower the thing to its place (5), let go (6). A dropped thing is one to
pick up again. Of each task its own module says what is seen and where things belong.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.task import GymTask, Seen, Term, by_name, causal_sets
from causalbench_robosuite import approach, tcp

Array = NDArray[np.float64]


class Constants(NamedTuple):
    """Every number of a task; metres."""

    approach: approach.Approach
    carry: float  # of the thing above its place while it is carried
    placed: float  # of the thing above its place, below which it may be let go
    place: float  # of the thing beside its place, each axis, from where it is lowered
    away: float = 0.1  # of the hand above a thing that it let go
    bonus: float = 2.0


TERMS = (
    *approach.TERMS,
    Term("r_lift", (4,), True, "approach of the thing to the height of carrying"),
    Term("r_goalx", (4,), True, "approach of the thing to its place along x"),
    Term("r_goaly", (4,), True, "approach of the thing to its place along y"),
    Term("r_turn", (4,), True, "turning the thing as its place is"),
    Term("r_carried", (4,), True, "robosuite's lifting and hovering parts, their change"),
    Term("r_down", (5,), True, "approach of the thing to its place's height"),
    Term("r_release", (6,), True, "opening of the fingers"),
    Term("r_away", (6,), True, "rising of the hand"),
    Term("r_success", (1, 2, 3, 4, 5, 6), False, "bonus for a step into a later stage or to success"),
)
STATE_NAMES = (*approach.STATE_NAMES, "way_x", "way_y", "way_z", "turn")
N = len(STATE_NAMES)


def look(
    robot: Any, holds: tuple[Array, float, bool], way: Array, turn: float, says: tuple[float, float, bool]
) -> Array:
    """The state variables (15,), then what robosuite `says`: its reaching part, what carrying pays, its success.

    `holds` is what `approach.look` is told, `way` (3,) m that of the thing to its place, `turn` how far it is off.
    """
    return np.array([*approach.look(robot, *holds), *way, turn, *says])


def observe(seen: Seen) -> Array:
    """The state variables (15,)."""
    return np.asarray(seen.observation[:N])


def stage(c: Constants, seen: Seen) -> int:
    """U(s), from 1."""
    state = observe(seen)
    way = np.abs(state[11:14])
    over = bool((way[:2] < c.place).all())
    if over and way[2] < c.placed:
        return 6
    u = approach.stage(c.approach, state)
    return 5 if u == 4 and over else u


def success(before: int, now: Seen) -> bool:
    """robosuite's success after a step from stage 6, with the thing let go."""
    return bool(before == 6 and now.observation[-1] and not now.observation[10])


def _left(c: Constants, seen: Seen) -> Array:
    """What the terms pay for getting smaller (19,)."""
    state, (reach, carried, _), near = observe(seen), seen.observation[N:], c.approach
    way = state[11:14]
    metres = np.abs([way[2] + c.carry, way[0], way[1], way[2]])
    letting_go = [max(near.open - state[9], 0.0), max(c.away + state[5], 0.0)]
    lift, goal_x, goal_y, down, release, away = near.per_metre * np.array([*metres, *letting_go])
    turn, part = near.per_radian * abs(state[14]), -near.per_part * carried
    return np.array(
        [*approach.left(near, state, reach), lift, goal_x, goal_y, turn, part, down, release, away],
    )


def rewards(c: Constants, before: Seen, was: int, action: Array, now: Seen, becomes: int) -> Array:
    """The terms (20,) of a step, each as if it belonged to every stage."""
    bonus = c.bonus * (becomes > was or success(was, now))
    return np.append(_left(c, before) - _left(c, now), bonus)


def expert(c: Constants, seen: Seen) -> Array:
    """Proportional control of what the stage asks for."""
    state, u = observe(seen), stage(c, seen)
    if u <= 3:
        return approach.expert(c.approach, state, u)
    if u == 6:
        up = np.array([0.0, 0.0, (c.away + 0.02 + state[5]) * (state[9] > c.approach.width + 0.01)])
        return approach.drive(state, up, -1.0)
    move = state[11:14] + [0.0, 0.0, c.carry * (u == 4)]
    move[:2] *= u == 5 or abs(move[2]) < 0.03  # up first
    turned = np.array([*state[:8], state[14], *state[9:]])  # the fingers turn with the thing
    return approach.drive(turned, move, 1.0)


CAUSES = {
    **approach.CAUSES,
    4: {"r_lift": "z", "r_goalx": "x", "r_goaly": "y", "r_turn": "rz", "r_carried": "x y z grip"},
    5: {"r_down": "z"},
    6: {"r_release": "grip", "r_away": "z"},
}


def pick_task(name: str, env_id: str, make: Callable[[], Any], c: Constants) -> GymTask:
    """The task `name` over the environment that `make` makes, which shows what `look` says."""
    return GymTask(
        name=name,
        version=0,
        env_id=env_id,
        n_stages=6,
        actions=tcp.ACTIONS,
        terms=TERMS,
        state_names=STATE_NAMES,
        horizon=250,
        constants=by_name(c),
        manual_graph=causal_sets(CAUSES),
        environments={"robosuite": make},
        stage=partial(stage, c),
        success=success,
        rewards=partial(rewards, c),
        observe=observe,
        state_bounds=(np.array([*approach.LOW, *[-0.8] * 3, -1.6]), np.array([*approach.HIGH, *[0.8] * 3, 1.6])),
        snapshot=tcp.snapshot,
        restore=tcp.restore,
        exact_restore=True,
        expert=partial(expert, c),
        modules=("mujoco", "robosuite"),
    )
