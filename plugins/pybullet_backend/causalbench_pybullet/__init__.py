"""Gymnasium-Robotics' Fetch in Bullet as a causalbench scene. Importing this imports no simulator."""

from __future__ import annotations

from collections.abc import Callable

import causalbench_mujoco
from causalbench.backend import Backend, Capability, Scene, Variant, base_following, hookimpl, require

__version__ = "0.1.0"
CAPABILITIES = frozenset({Capability.EXACT_RESTORE, Capability.PHYSICS, Capability.RGB, Capability.SEVERAL_OBJECTS})
RELEASES = {"pybullet": "==3.2.7", "mujoco": causalbench_mujoco.RELEASES, "gymnasium-robotics": "==1.4.2"}
"""What is known to work; MuJoCo compiles the robot."""

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
    require(RELEASES)  # before the imports below: a broken version may fail in them with an obscure message
    from causalbench_pybullet.mobile import MobilePybulletScene
    from causalbench_pybullet.scene import PybulletScene

    if solver_iterations is None:
        solver_iterations = MOBILE_ITERATIONS if mobile else ITERATIONS
    return (MobilePybulletScene if mobile else PybulletScene)(control_hz, timestep, solver_iterations)


@hookimpl
def causalbench_backends(register: Callable[[Backend], None]) -> None:
    """Register the backend "pybullet"."""
    modules = ("pybullet", "mujoco", "gymnasium_robotics")
    mobile = Variant("Fetch", CAPABILITIES | base_following.DRIVING_CAPABILITIES, {"mobile": True})
    register(Backend("pybullet", make, "Bullet", (Variant("Fetch", CAPABILITIES), mobile), modules))
