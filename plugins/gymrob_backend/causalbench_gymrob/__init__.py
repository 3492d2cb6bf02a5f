"""Gymnasium-Robotics' Fetch in MuJoCo as a causalbench scene. Importing this imports no simulator."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from causalbench.core.kit.base_following import DRIVING_CAPABILITIES
from causalbench.core.world.capabilities import Capability
from causalbench.plugins.hookspecs import Backend, hookimpl

if TYPE_CHECKING:
    from causalbench.core.world.scene import Scene

__version__ = "0.1.0"
CAPABILITIES = frozenset({Capability.EXACT_RESTORE, Capability.PHYSICS, Capability.RGB})


def make(control_hz: float = 10.0, timestep: float = 0.005, mobile: bool = False) -> Scene:
    """A new scene that takes `control_hz` actions per second and integrates in steps of `timestep` seconds.

    With `mobile` the base drives, and there is a LiDAR.

    Raises `BrokenVersionError` when the installed simulator is a version that is known not to work.
    """
    from causalbench_gymrob.versions import check_versions

    check_versions()  # before the import below: a broken version may fail in it with an obscure message
    if mobile:
        from causalbench_gymrob.mobile import MobileGymrobScene

        return MobileGymrobScene(control_hz, timestep)
    from causalbench_gymrob.scene import GymrobScene

    return GymrobScene(control_hz, timestep)


@hookimpl
def causalbench_backends(register: Callable[[Backend], None]) -> None:
    """Register the backend "gymrob"."""
    modules = ("mujoco", "gymnasium_robotics")
    register(
        Backend("gymrob", make, "MuJoCo", "Fetch", modules, CAPABILITIES, mobile_capabilities=DRIVING_CAPABILITIES)
    )
