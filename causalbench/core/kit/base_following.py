"""What scenes whose base drives have in common: their spec, and how servos on x, y and yaw follow the base actions."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from causalbench.core.world.capabilities import Capability
from causalbench.core.world.layout import Carry
from causalbench.core.world.scene import ACTION_SPEED, BASE_ACTIONS, SceneSpec

Array = NDArray[np.float64]

LEAD = 0.02  # m and rad by which the reference may run ahead of a base that something stops
DRIVING_CAPABILITIES = frozenset({Capability.MOBILE_BASE, Capability.LIDAR})
SPEED = np.array([ACTION_SPEED[name] for name in BASE_ACTIONS])  # m/s, rad/s


def driving_spec(spec: SceneSpec, carry: Carry, lidar_position: tuple[float, float, float]) -> SceneSpec:
    """The spec of a robot that stands, changed to that of one with a base that drives and a LiDAR."""
    return replace(
        spec,
        actions=(*BASE_ACTIONS, *spec.actions),
        action_speed=(*SPEED.tolist(), *spec.action_speed),
        workspace=replace(spec.workspace, carry=carry),
        capabilities=spec.capabilities | DRIVING_CAPABILITIES,
        lidar_position=lidar_position,
    )


def follow(reference: Array, measured: Array, way: Array, dt: float) -> Array:
    """Velocities (3,) of x, y and yaw, m/s and rad/s in the world, that take the base along `way` within `dt` seconds.

    `reference` (3,) is where the base shall be. It moves in place by `way` (2,), metres forward and radians of turn,
    along the heading half-way through the turn, and starts within `LEAD` of the `measured` pose (3,), so that pushing
    winds nothing up. Since the velocities lead to the reference, the base does not drift while the way is 0.
    """
    for i in range(3):
        reference[i] = min(max(reference[i], measured[i] - LEAD), measured[i] + LEAD)
    heading = reference[2] + way[1] / 2
    reference += np.array([way[0] * math.cos(heading), way[0] * math.sin(heading), way[1]])
    return (reference - measured) / dt
