"""robosuite's NutAssemblySquare: a square nut, held by its handle, onto a square peg, in the six stages of `pick`.

robosuite's: the environment, its seven actions, the grasp, the parts "reach", "lift" and "hover", and success, a nut
low around its peg; nothing latches where there is one nut. Ours: stages, the other terms, that the nut turns as the peg
is, and that it was let go in stage 6.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench_robosuite import pick, tcp
from causalbench_robosuite.approach import Approach

HEIGHT = 0.83  # m of a nut's centre where it lies on the table


def look(inner: Any) -> NDArray[np.float64]:
    """What is seen, see `pick.look`."""
    robot, data, nut = inner.robots[0], inner.sim.data, inner.obj_body_id["SquareNut"]
    success = inner._check_success()  # brings up to date what robosuite says of the pegs
    handle = data.get_site_xpos(inner.nuts[0].important_sites["handle"])
    place = np.array([*data.body_xpos[inner.peg1_body_id][:2], HEIGHT])
    along = tcp.direction(data.body_xmat[nut])
    yaw = tcp.nearest(tcp.direction(tcp.axes(robot)) - along - np.pi / 2, np.pi)
    holds = handle, yaw, inner._check_grasp(robot.gripper, inner.nuts[0].contact_geoms)
    way, turn = place - data.body_xpos[nut], tcp.nearest(along, np.pi / 2)
    reach, _, *carried = inner.staged_rewards()
    return pick.look(robot, holds, way, turn, (reach, max(carried), success))


def make() -> Any:
    """A new environment."""
    from causalbench_robosuite.native import Native

    return Native("NutAssemblySquare", look, 1)


TASK = pick.pick_task(
    "nut_assembly_square",
    "causalbench_robosuite/NutAssemblySquare-v0",
    make,
    pick.Constants(Approach(width=0.032), carry=0.16, placed=0.03, place=0.008),
)
