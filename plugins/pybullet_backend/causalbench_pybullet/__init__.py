"""Gymnasium-Robotics' Fetch in Bullet as a causalbench scene. Importing this imports no simulator."""

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

# On a base that can give way the solver converges more slowly: with 20 passes a held box turns in the hand.
ITERATIONS, MOBILE_ITERATIONS = 20, 50


def make(
    control_hz: float = 10.0, timestep: float = 1 / 240, solver_iterations: int | None = None, mobile: bool = False
) -> Scene:
    """A new scene that takes `control_hz` actions per second and integrates in steps of `timestep` seconds.

    In each of them Bullet's solver makes `solver_iterations` passes over the constraints, by default 20, or 50 with
    `mobile`: then the base drives, and there is a LiDAR. Raises `BrokenVersionError` when something installed is a
    version that is known not to work.
    """
    from causalbench_pybullet.versions import check_versions

    check_versions()  # before the import below: a broken version may fail in it with an obscure message
    if solver_iterations is None:
        solver_iterations = MOBILE_ITERATIONS if mobile else ITERATIONS
    if mobile:
        from causalbench_pybullet.mobile import MobilePybulletScene

        return MobilePybulletScene(control_hz, timestep, solver_iterations)
    from causalbench_pybullet.scene import PybulletScene

    return PybulletScene(control_hz, timestep, solver_iterations)


@hookimpl
def causalbench_backends(register: Callable[[Backend], None]) -> None:
    """Register the backend "pybullet"."""
    modules = ("pybullet", "mujoco", "gymnasium_robotics")
    register(
        Backend("pybullet", make, "Bullet", "Fetch", modules, CAPABILITIES, mobile_capabilities=DRIVING_CAPABILITIES)
    )
