"""The kinematic reference backend: a floating hand in numpy. It is not physics."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from causalbench.core.kinematic.scenes import WorldsScene


def make(mobile: bool = False) -> WorldsScene:
    """A new kinematic scene; with `mobile` the hand is carried by a base that drives, and there is a LiDAR."""
    from causalbench.core.kinematic.scenes import WorldsScene

    if mobile:
        from causalbench.core.kinematic.mobile import MobileWorlds

        return WorldsScene(MobileWorlds(()))
    from causalbench.core.kinematic.worlds import KinematicWorlds

    return WorldsScene(KinematicWorlds(()))
