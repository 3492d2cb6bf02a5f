"""robosuite's Stack: a cube of 4 cm onto one of 5 cm, in the six stages of `pick`.

robosuite's: the environment, its seven actions, the grasp, the parts "reach" and "lift and align", and success, cubes
that touch with the upper one not grasped. Ours: stages, the other terms, and that the hand went through stage 6.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench_robosuite import pick, tcp
from causalbench_robosuite.approach import Approach

UP = np.array([0.0, 0.0, 0.045])  # m of the cube's centre above the other's


def look(inner: Any) -> NDArray[np.float64]:
    """What is seen, see `pick.look`."""
    data, robot = inner.sim.data, inner.robots[0]
    cube, other = data.body_xpos[inner.cubeA_body_id], data.body_xpos[inner.cubeB_body_id]
    a, b = (tcp.direction(data.body_xmat[i]) for i in (inner.cubeA_body_id, inner.cubeB_body_id))
    reach, carried, stacked = inner.staged_rewards()
    yaw = tcp.nearest(tcp.direction(tcp.axes(robot)) - a, np.pi / 2)
    holds = cube, yaw, inner._check_grasp(robot.gripper, inner.cubeA)
    return pick.look(robot, holds, other + UP - cube, tcp.nearest(a - b, np.pi / 2), (reach, carried, stacked > 0))


def make() -> Any:
    """A new environment."""
    from causalbench_robosuite.native import Native

    return Native("Stack", look, 1)


TASK = pick.pick_task(
    "stack_cubes",
    "causalbench_robosuite/StackCubes-v0",
    make,
    pick.Constants(Approach(width=0.04), carry=0.06, placed=0.008, place=0.012),
)
