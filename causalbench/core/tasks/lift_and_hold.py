"""A grasp counts only if it bears load: lift the object and hold it still."""

from __future__ import annotations

import numpy as np

from causalbench.core.world.scene import Scene

LIFT_TIME, HOLD_TIME = 1.2, 2.0  # s
LIFT_ACTION = 0.5  # of full armz
MIN_RISE = 0.06  # m, half of what a firm grasp rises at the default speed of armz


def lift_and_hold(scene: Scene) -> bool:
    """Lift the held object with armz, then idle, the grip action being 0 throughout.

    True if the object's centre has risen by more than `MIN_RISE` at the end of the lift and stays so.
    """
    action = np.zeros(len(scene.spec.actions))
    start = float(scene.facts().object_position[2])
    action[scene.spec.actions.index("armz")] = LIFT_ACTION
    for _ in range(round(LIFT_TIME / scene.spec.control_dt)):
        scene.step(action)
    action[:] = 0.0
    rises = [float(scene.facts().object_position[2]) - start]
    for _ in range(round(HOLD_TIME / scene.spec.control_dt)):
        scene.step(action)
        rises.append(float(scene.facts().object_position[2]) - start)
    return min(rises) > MIN_RISE
