"""What the tasks ask of an arm's reach."""

from __future__ import annotations

import math
from itertools import product

from causalbench.core.tasks import pure_manipulation as task
from causalbench.core.world.reach import ReachDemands

_SLANT = task.TOLERANCE_ORI / math.sqrt(2)
_TILTED = tuple(product((task.TILT_LOW, 0.675, task.TILT_HIGH), (-task.ROLL, 0.0, task.ROLL)))
_FACE_DOWN = tuple(product((-_SLANT, 0.0, _SLANT), (-_SLANT, 0.0, _SLANT)))

PURE_MANIPULATION = ReachDemands(
    rise=task.BOX_HALF_EXTENTS[2],
    offset=task.TOLERANCE_XY,
    poses=(
        (task.HOVER - task.TOLERANCE_HOVER, _TILTED + _FACE_DOWN),
        (task.HOVER + task.TOLERANCE_HOVER, _TILTED + _FACE_DOWN),
        (task.GRASP_HEIGHT, _FACE_DOWN),
    ),
    tilts=_TILTED,
    draw_start=lambda rng, workspace, max_opening: task.draw_layout(rng, workspace, max_opening, 1),
    is_start=lambda facts: bool(task.stage(facts) == 1),
)
"""A box is hovered over, tilted or not, and grasped face down, at all tolerated offsets."""
