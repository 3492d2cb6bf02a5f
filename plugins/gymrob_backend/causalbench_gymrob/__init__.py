"""Gymnasium-Robotics' Fetch in MuJoCo as a causalbench scene. Importing this imports no simulator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import causalbench_mujoco
from causalbench.backend import Backend, Capability, Scene, Variant, base_following, hookimpl, require

__version__ = "0.1.0"
CAPABILITIES = frozenset({Capability.EXACT_RESTORE, Capability.PHYSICS, Capability.RGB, Capability.SEVERAL_OBJECTS})
RELEASES = {"mujoco": causalbench_mujoco.RELEASES, "gymnasium-robotics": "==1.4.2"}
"""What is known to work: the one release whose Fetch assets `model.py` edits."""


def make(control_hz: float = 10.0, timestep: float = 0.005, mobile: bool = False) -> Scene:
    """A new scene that takes `control_hz` actions per second and integrates in steps of `timestep` seconds.

    With `mobile` the base drives, and there is a LiDAR.

    Raises `BrokenVersionError` when the installed simulator is a version that is known not to work.
    """
    require(RELEASES)  # before the import below: a broken version may fail in it with an obscure message
    from causalbench_gymrob.scene import GymrobScene

    return GymrobScene(control_hz, timestep, mobile)


@hookimpl
def causalbench_tasks(register: Callable[[Any], None]) -> None:
    """Register what gymnasium-robotics' own environments become in stages."""
    from causalbench_gymrob import fetch_pick_and_place, franka_kitchen

    for module in (fetch_pick_and_place, franka_kitchen):
        register(module.TASK)


@hookimpl
def causalbench_backends(register: Callable[[Backend], None]) -> None:
    """Register the backend "gymrob"."""
    modules = ("mujoco", "gymnasium_robotics")
    mobile = Variant("Fetch", CAPABILITIES | base_following.DRIVING_CAPABILITIES, {"mobile": True})
    register(Backend("gymrob", make, "MuJoCo", (Variant("Fetch", CAPABILITIES), mobile), modules))
