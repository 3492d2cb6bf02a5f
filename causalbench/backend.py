"""An author of a backend imports this module and `causalbench.core.kit`; `docs/plugins.md` says what each name does.

Importing it imports neither a simulator nor what takes time to compile: modules with compiled functions are imported
when they are first asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from causalbench.core.kit import base_following as base_following
from causalbench.core.kit import stepping as stepping
from causalbench.core.kit.environment_variables import variable_by_default
from causalbench.core.kit.robots import fetch as fetch
from causalbench.core.kit.snapshots import SnapshotCodec
from causalbench.core.kit.versions import require
from causalbench.core.numerics import rotations as rotations
from causalbench.core.numerics.compiled import compiled, external
from causalbench.core.world.batch import Batchable, BatchScene
from causalbench.core.world.cameras import FOV, Camera, find_camera
from causalbench.core.world.capabilities import Capability
from causalbench.core.world.facts import HOLDING_FORCE, Facts
from causalbench.core.world.layout import Box, Carry, Layout, Workspace
from causalbench.core.world.scene import (
    ACTION_SPEED,
    ARM_ACTIONS,
    BASE_ACTIONS,
    Scene,
    SceneSpec,
    check_action,
    check_layout,
)
from causalbench.errors import (
    BrokenVersionError,
    CausalbenchError,
    InvalidActionError,
    SnapshotError,
    UnreachableLayoutError,
    UserError,
)
from causalbench.lazy import lazy
from causalbench.plugins.backends import Backend, Variant
from causalbench.plugins.hookspecs import hookimpl

if TYPE_CHECKING:
    from causalbench.core.kit import arm_ik as arm_ik
    from causalbench.core.kit import joint_following as joint_following
    from causalbench.core.kit import reach_scan as reach_scan
    from causalbench.core.numerics import kernels as kernels
    from causalbench.core.numerics import linear as linear
    from causalbench.core.tasks import reach_demands as reach_demands
    from causalbench.core.world import lidar as lidar

_COMPILED = {
    "arm_ik": "causalbench.core.kit.arm_ik",
    "joint_following": "causalbench.core.kit.joint_following",
    "kernels": "causalbench.core.numerics.kernels",
    "lidar": "causalbench.core.world.lidar",
    "linear": "causalbench.core.numerics.linear",
    "reach_demands": "causalbench.core.tasks.reach_demands",
    "reach_scan": "causalbench.core.kit.reach_scan",
}

__all__ = [
    "ACTION_SPEED",
    "ARM_ACTIONS",
    "BASE_ACTIONS",
    "FOV",
    "HOLDING_FORCE",
    "Backend",
    "BatchScene",
    "Batchable",
    "Box",
    "BrokenVersionError",
    "Camera",
    "Capability",
    "Carry",
    "CausalbenchError",
    "Facts",
    "InvalidActionError",
    "Layout",
    "Scene",
    "SceneSpec",
    "SnapshotCodec",
    "SnapshotError",
    "UnreachableLayoutError",
    "UserError",
    "Variant",
    "Workspace",
    "arm_ik",
    "base_following",
    "check_action",
    "check_layout",
    "compiled",
    "external",
    "fetch",
    "find_camera",
    "hookimpl",
    "joint_following",
    "kernels",
    "lidar",
    "linear",
    "reach_demands",
    "reach_scan",
    "require",
    "rotations",
    "stepping",
    "variable_by_default",
]

__getattr__ = lazy(__name__, _COMPILED)
