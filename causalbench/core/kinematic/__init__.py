"""The kinematic reference backend: a floating hand in numpy. It is not physics."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from causalbench.core.world.scene import Scene


def make(mobile: bool = False) -> Scene:
    """A new kinematic scene; with `mobile` the hand is carried by a base that drives, and there is a LiDAR."""
    if mobile:
        from causalbench.core.kinematic.mobile import MobileKinematicScene

        return MobileKinematicScene()
    from causalbench.core.kinematic.worlds import KinematicScene

    return KinematicScene()
