"""What the tasks ask of an arm's reach."""

from __future__ import annotations

import math
from itertools import product

from causalbench.core.tasks import pure_manipulation as task
from causalbench.core.tasks import pure_manipulation_data as numbers
from causalbench.core.world.reach import ReachDemands

_SLANT = numbers.C.tolerance_ori / math.sqrt(2)
_TILTED = tuple(product((numbers.C.tilt_low, 0.675, numbers.C.tilt_high), (-numbers.C.roll, 0.0, numbers.C.roll)))
_FACE_DOWN = tuple(product((-_SLANT, 0.0, _SLANT), (-_SLANT, 0.0, _SLANT)))

PURE_MANIPULATION = ReachDemands(
    rise=numbers.C.box_half_extents[2],
    offset=numbers.C.tolerance_xy,
    poses=(
        (numbers.C.hover - numbers.C.tolerance_hover, _TILTED + _FACE_DOWN),
        (numbers.C.hover + numbers.C.tolerance_hover, _TILTED + _FACE_DOWN),
        (numbers.C.grasp_height, _FACE_DOWN),
    ),
    tilts=_TILTED,
    draw_start=lambda rng, workspace, max_opening: task.draw_layout(rng, workspace, max_opening, 1),
    is_start=lambda facts: bool(task.stage(facts) == 1),
)
"""A box is hovered over, tilted or not, and grasped face down, at all tolerated offsets."""
