"""robosuite's Panda and PandaOmron in MuJoCo as a causalbench scene. Importing this imports no simulator."""

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


def make(control_hz: float = 10.0, timestep: float = 0.002, mobile: bool = False) -> Scene:
    """A new scene that takes `control_hz` actions per second and integrates in steps of `timestep` seconds.

    With `mobile` it is the PandaOmron, whose base drives, and there is a LiDAR.

    Raises `BrokenVersionError` when the installed simulator is a version that is not known to work.
    """
    from causalbench_robosuite.versions import check_versions

    check_versions()  # before the import below: a broken version may fail in it with an obscure message
    if mobile:
        from causalbench_robosuite.mobile import MobileRobosuiteScene

        return MobileRobosuiteScene(control_hz, timestep)
    from causalbench_robosuite.scene import RobosuiteScene

    return RobosuiteScene(control_hz, timestep)


@hookimpl
def causalbench_backends(register: Callable[[Backend], None]) -> None:
    """Register the backend "robosuite"."""
    modules = ("mujoco", "robosuite")
    register(
        Backend("robosuite", make, "MuJoCo", "Panda", modules, CAPABILITIES, mobile_capabilities=DRIVING_CAPABILITIES)
    )
