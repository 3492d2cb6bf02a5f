"""A grasp counts only if it bears load: lift the object and hold it still."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from causalbench.core.world.scene import Scene


class Constants(NamedTuple):
    """Every number of the test, part of the identity of the tasks that put their successes to it."""

    lift_time: float = 1.2  # s
    hold_time: float = 2.0  # s
    lift_action: float = 0.5  # of full armz
    min_rise: float = 0.06  # m, half of what a firm grasp rises at the default speed of armz


C = Constants()


def lift_and_hold(scene: Scene) -> bool:
    """Lift the held object with armz, then idle, with grip at 0, and return whether the object stays in the hand.

    This is true if the object's centre has risen by more than `C.min_rise` at the end of the lift and stays so.
    """
    action = np.zeros(len(scene.spec.actions))
    start = float(scene.facts().object_position[2])
    action[scene.spec.actions.index("armz")] = C.lift_action
    for _ in range(round(C.lift_time / scene.spec.control_dt)):
        scene.step(action)
    action[:] = 0.0
    rises = [float(scene.facts().object_position[2]) - start]
    for _ in range(round(C.hold_time / scene.spec.control_dt)):
        scene.step(action)
        rises.append(float(scene.facts().object_position[2]) - start)
    return min(rises) > C.min_rise
