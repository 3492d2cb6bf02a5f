"""What a world can do beyond the least that every world can: the one place where capabilities are listed."""

from __future__ import annotations

from enum import StrEnum


class Capability(StrEnum):
    """What a world can do beside stepping. A world declares it, and a task may require it. It is a plain string.

    A scene declares those of `SCENE_CAPABILITIES`; the others are what staged worlds offer, whatever they are made of.

    - `RGB`: pictures can be drawn of the world, from every camera that stands in it.
    - `LIDAR`: a level scanner on the base gives ranges.
    - `EXACT_RESTORE`: after a snapshot is restored, every later step is bit-identical to the first time.
    - `MOBILE_BASE`: the robot's base drives and turns, and a target of mass 0 may mark a place.
    - `PHYSICS`: free things fall, are pushed and rest on others.
    - `SEVERAL_OBJECTS`: a layout may have free boxes beside the target, each of which the hand can hold.
    - `RESTORE`: a snapshot of a world can be taken and returned to.
    - `STAGE_RESET`: a world can be reset into any stage of its task, not only into the first.
    - `EXPERT`: a scripted expert says what to do next.
    """

    RGB = "rgb"
    LIDAR = "lidar"
    EXACT_RESTORE = "exact_restore"
    MOBILE_BASE = "mobile_base"
    PHYSICS = "physics"
    SEVERAL_OBJECTS = "several_objects"
    RESTORE = "restore"
    STAGE_RESET = "stage_reset"
    EXPERT = "expert"

    __repr__ = str.__repr__


EVERY_SCENE = frozenset({Capability.RESTORE, Capability.STAGE_RESET, Capability.EXPERT})
"""What staged worlds over scenes can do: every scene restores, every task over scenes has starts and an expert."""

SCENE_CAPABILITIES = frozenset(Capability) - EVERY_SCENE
"""What a `SceneSpec` may declare."""


def lacking(capability: Capability, purpose: str, backend: str, task: str) -> str:
    """The sentence that refuses `purpose` where worlds of `task` in `backend` do not have `capability`."""
    return f"{purpose} needs the capability {capability!r}, and {backend} does not have it in task {task!r}"
