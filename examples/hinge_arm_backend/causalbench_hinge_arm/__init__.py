"""A causalbench backend. Importing this imports no simulator: S36 of the contract."""

from __future__ import annotations

from collections.abc import Callable

from causalbench.backend import Backend, Capability, Scene, Variant, hookimpl

ENGINE, ROBOT = "MuJoCo", "six-hinge arm"
MODULES = ("mujoco", "causalbench_mujoco")
CAPABILITIES = frozenset({Capability.EXACT_RESTORE, Capability.LIDAR, Capability.PHYSICS, Capability.RGB})


def make() -> Scene:
    """A new scene."""
    from causalbench_hinge_arm.scene import HingeArmScene

    return HingeArmScene()


@hookimpl
def causalbench_backends(register: Callable[[Backend], None]) -> None:
    """Register the backend."""
    register(Backend("hinge_arm", make, ENGINE, (Variant(ROBOT, CAPABILITIES),), MODULES))
