"""Gymnasium-Robotics' Fetch in Bullet as a causalbench scene. Importing this imports no simulator."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from causalbench.hookspecs import Backend, hookimpl

if TYPE_CHECKING:
    from causalbench.core.scene import Scene

__version__ = "0.1.0"


def make(control_hz: float = 10.0, timestep: float = 1 / 240, solver_iterations: int = 20) -> Scene:
    """A new scene that takes `control_hz` actions per second and integrates in steps of `timestep` seconds.

    In each of them Bullet's solver makes `solver_iterations` passes over the constraints. Raises
    `BrokenVersionError` when something installed is a version that is known not to work.
    """
    from causalbench_pybullet.versions import check_versions

    check_versions()  # before the import below: a broken version may fail in it with an obscure message
    from causalbench_pybullet.scene import PybulletScene

    return PybulletScene(control_hz, timestep, solver_iterations)


@hookimpl
def causalbench_backends(register: Callable[[Backend], None]) -> None:
    """Register the backend "pybullet"."""
    modules = ("pybullet", "mujoco", "gymnasium_robotics")
    register(Backend("pybullet", make, "Bullet", "Fetch", modules, frozenset({"exact_restore", "physics", "rgb"})))
