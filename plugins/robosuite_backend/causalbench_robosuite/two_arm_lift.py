"""robosuite's TwoArmLift: two arms take a pot by its handles (1 to 3, those of `approach`), lift it (4), carry it (5).

robosuite's: the environment, the seven actions of each arm, the grasps, the reaching and lifting parts, and success, a
pot 10 cm above the table, level within 30 degrees as for the full reward. Ours: stages and the other terms. U(s) is the
stage of the hand that is behind: a hand that is ahead waits, and one that lets go takes hold again.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.task import GymTask, Seen, Term, by_name, causal_sets
from causalbench_robosuite import approach, tcp

Array = NDArray[np.float64]


class Constants(NamedTuple):
    """Every number of the task; metres and radians."""

    approach: approach.Approach = approach.Approach(width=0.02)
    lifted: float = 0.06  # of the pot's bottom above the table, from where it is carried: robosuite pays from 0.05
    height: float = 0.15  # of it, where the term of rising ends
    level: float = np.pi / 6  # of the pot's tilt, within which it counts as lifted: robosuite's
    per_lift: float = 7.0  # of robosuite's lifting part
    bonus: float = 2.0


C = Constants()
HANDS = ("a", "b")
TERMS = (
    *approach.terms_of(*HANDS),
    Term("r_height", (4, 5), True, "rising of the pot"),
    Term("r_level", (4, 5), True, "levelling of the pot"),
    Term("r_lift", (5,), True, "robosuite's lifting part, its change"),
    Term("r_success", (1, 2, 3, 4, 5), False, "bonus for a step into a later stage or to success"),
)
STATE_NAMES = (*(f"{hand}_{name}" for hand in HANDS for name in approach.STATE_NAMES), "pot_height", "pot_tilt")
N = len(STATE_NAMES)
LIFTING = dict.fromkeys(("r_height", "r_level"), "a_z b_z")
CAUSES = approach.causes_of(*HANDS) | {4: LIFTING, 5: LIFTING | {"r_lift": "a_z b_z"}}


def look(inner: Any) -> Array:
    """The state variables (24,), then robosuite's reaching parts (2,), its lifting part and its success."""
    data, pot = inner.sim.data, np.array(inner.sim.data.body_xmat[inner.pot_body_id]).reshape(3, 3)
    handles = (inner._handle0_xpos, inner.pot.handle0_geoms), (inner._handle1_xpos, inner.pot.handle1_geoms)
    hands, reaches = [], []
    for robot, (hold, geoms) in zip(inner.robots, handles, strict=True):
        across = tcp.direction(tcp.base(robot).T @ pot, 1)  # fingers close across the bar of a handle
        yaw = tcp.nearest(tcp.direction(tcp.axes(robot)) - across, np.pi)
        hands.append(approach.look(robot, hold, yaw, inner._check_grasp(robot.gripper, geoms)))
        reaches.append(0.5 * (1 - np.tanh(10.0 * np.linalg.norm(hold - tcp.position(robot)))))
    bottom = data.site_xpos[inner.pot_center_id][2] - inner.pot.top_offset[2]
    height, tilt = bottom - data.site_xpos[inner.table_top_id][2], np.arccos(np.clip(pot[2, 2], -1.0, 1.0))
    lifted = 10.0 * min(max(height - 0.05, 0.0), 0.15) * (tilt <= C.level)
    return np.array([*hands[0], *hands[1], height, tilt, *reaches, lifted, inner._check_success()])


def make() -> Any:
    """A new environment."""
    from causalbench_robosuite.native import Native

    return Native("TwoArmLift", look, 2)


def observe(seen: Seen) -> Array:
    """The state variables (24,)."""
    return np.asarray(seen.observation[:N])


def _hands(seen: Seen) -> list[Array]:
    return np.split(observe(seen)[:-2], 2)


def stage(seen: Seen) -> int:
    """U(s), from 1."""
    u = min(approach.stage(C.approach, hand) for hand in _hands(seen))
    return 5 if u == 4 and observe(seen)[-2] > C.lifted else u


def success(before: int, now: Seen) -> bool:
    """robosuite's success after a step from stage 5, with the pot level."""
    return bool(before == 5 and now.observation[-1] and observe(now)[-1] <= C.level)


def _left(seen: Seen) -> Array:
    """What the terms pay for getting smaller (25,)."""
    (height, tilt), (*reaches, lifted, _), near = observe(seen)[-2:], seen.observation[N:], C.approach
    hands = [approach.left(near, hand, reach) for hand, reach in zip(_hands(seen), reaches, strict=True)]
    pot = near.per_metre * abs(C.height - height), near.per_radian * tilt, -C.per_lift * lifted
    return np.concatenate([*hands, pot])


def rewards(before: Seen, was: int, action: Array, now: Seen, becomes: int) -> Array:
    """The terms (26,) of a step, each as if it belonged to every stage."""
    bonus = C.bonus * (becomes > was or success(was, now))
    return np.append(_left(before) - _left(now), bonus)


def expert(seen: Seen) -> Array:
    """Each hand does what the stage of both asks for; when both hold, both rise."""
    u, up = stage(seen), np.array([0.0, 0.0, 0.03])
    if u < 4:
        return np.concatenate([approach.expert(C.approach, hand, u) for hand in _hands(seen)])
    return np.concatenate([approach.drive(hand, hand[3:6] + up, 1.0) for hand in _hands(seen)])


LOW, HIGH = [*approach.LOW] * 2, [*approach.HIGH] * 2
TASK = GymTask(
    name="two_arm_lift", version=0, env_id="causalbench_robosuite/TwoArmLift-v0", n_stages=5, horizon=200,
    actions=tuple(f"{hand}_{action}" for hand in HANDS for action in tcp.ACTIONS), terms=TERMS,
    state_names=STATE_NAMES, state_bounds=(np.array([*LOW, -0.05, -0.01]), np.array([*HIGH, 0.4, 1.6])),
    constants=by_name(C), manual_graph=causal_sets(CAUSES), environments={"robosuite": make}, stage=stage,
    success=success, rewards=rewards, observe=observe, expert=expert, snapshot=tcp.snapshot, restore=tcp.restore,
    exact_restore=True, modules=("mujoco", "robosuite"),
)  # fmt: skip
