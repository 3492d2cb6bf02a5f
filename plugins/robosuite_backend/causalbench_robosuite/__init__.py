"""robosuite's Panda and PandaOmron in MuJoCo as a causalbench scene. Importing this imports no simulator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from causalbench.backend import Backend, Capability, Scene, Variant, base_following, hookimpl, require

__version__ = "0.1.0"
CAPABILITIES = frozenset({Capability.EXACT_RESTORE, Capability.PHYSICS, Capability.RGB, Capability.SEVERAL_OBJECTS})
RELEASES = {"mujoco": "==3.3.*", "robosuite": "==1.5.2"}
"""What is known to work: the release whose models and controller are taken, and MuJoCo's whose inertia is read."""


def make(control_hz: float = 10.0, timestep: float = 0.002, mobile: bool = False) -> Scene:
    """A new scene that takes `control_hz` actions per second and integrates in steps of `timestep` seconds.

    With `mobile` it is the PandaOmron, whose base drives, and there is a LiDAR.

    Raises `BrokenVersionError` when the installed simulator is a version that is not known to work.
    """
    require(RELEASES)  # before the import below: a broken version may fail in it with an obscure message
    from causalbench_robosuite.scene import RobosuiteScene

    return RobosuiteScene(control_hz, timestep, mobile)


@hookimpl
def causalbench_tasks(register: Callable[[Any], None]) -> None:
    """Register what robosuite's own environments become in stages."""
    from causalbench_robosuite import nut_assembly_square, stack_cubes, two_arm_lift

    for module in (nut_assembly_square, stack_cubes, two_arm_lift):
        register(module.TASK)


@hookimpl
def causalbench_backends(register: Callable[[Backend], None]) -> None:
    """Register the backend "robosuite"."""
    modules = ("mujoco", "robosuite")
    mobile = Variant("PandaOmron", CAPABILITIES | base_following.DRIVING_CAPABILITIES, {"mobile": True})
    register(Backend("robosuite", make, "MuJoCo", (Variant("Panda", CAPABILITIES), mobile), modules))
