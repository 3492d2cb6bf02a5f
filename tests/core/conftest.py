"""Facts put together by hand."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from causalbench.core.world.facts import Facts

BOX = np.array([-0.1, 0.6, 0.725])


@pytest.fixture
def pose() -> Callable[..., Facts]:
    """Facts with the hand at `offset` from the box (world axes), tilted by `tilt` radians from straight down."""

    def pose(offset: tuple[float, float, float], tilt: float = 0.0, **changes) -> Facts:
        no = np.bool_(False)
        fields = {
            "eef_position": BOX + offset,
            # Straight down (0, 0, 1, 0), then turned about the hand's own y axis.
            "eef_quaternion": np.array([-math.sin(tilt / 2), 0.0, math.cos(tilt / 2), 0.0]),
            "gripper_opening": np.float64(0.1),
            "holding": no,
            "object_position": BOX.copy(),
            "object_quaternion": np.array([1.0, 0.0, 0.0, 0.0]),
            "base_pose": np.zeros(3),
            "base_velocity": np.zeros(2),
            "collision_base": no,
            "collision_arm": no,
            "collision_self": no,
        }
        return Facts(**fields | changes)

    return pose
