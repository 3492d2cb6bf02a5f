"""What scenes with physics have in common: how a control step falls into timesteps, and when a start is at rest."""

from __future__ import annotations

import math

import numpy as np

from causalbench.core.numerics import rotations
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout
from causalbench.errors import UnreachableLayoutError, UserError

MAX_TARGET_DT = 0.025  # s between new servo targets: in larger strides joints reach the lead limit and the hand swerves
SETTLE = 0.1  # s of simulation after a reset, for contacts to take their load
SETTLE_POSITION, SETTLE_ANGLE = 1e-3, math.radians(0.5)  # how far a settled start may lie off its layout


def whole_substeps(control_hz: float, timestep: float) -> int:
    """How many timesteps of `timestep` seconds one control step takes. Raises `UserError` if that is not whole."""
    substeps = round(1.0 / (control_hz * timestep))
    if substeps < 1 or abs(substeps * timestep * control_hz - 1.0) > 1e-9:
        raise UserError(f"one control step at {control_hz} Hz must be a whole number of timesteps of {timestep} s")
    return substeps


def target_parts(substeps: int, timestep: float) -> int:
    """Into how many equal parts of whole substeps a control step falls so that none exceeds `MAX_TARGET_DT`."""
    divisors = (parts for parts in range(1, substeps) if substeps % parts == 0)
    return next((parts for parts in divisors if substeps // parts * timestep <= MAX_TARGET_DT + 1e-9), substeps)


def check_settled(facts: Facts, layout: Layout) -> None:
    """Raise `UnreachableLayoutError` unless the settled start of `facts` is still that of `layout`."""
    off = max(
        np.abs(facts.eef_position - layout.eef_position).max(),
        np.abs(facts.object_position - layout.target.position).max(),
        *(
            float(np.abs(place - box.position).max())
            for place, box in zip(facts.other_positions, layout.others, strict=True)
        ),
    )
    turned = max(
        float(rotations.angle_between(facts.eef_quaternion, layout.eef_quaternion)),
        float(rotations.angle_between(facts.object_quaternion, layout.target.quaternion)),
        *(
            float(rotations.angle_between(posture, box.quaternion))
            for posture, box in zip(facts.other_quaternions, layout.others, strict=True)
        ),
    )
    if not (off <= SETTLE_POSITION and turned <= SETTLE_ANGLE):  # also when something is not finite
        raise UnreachableLayoutError(
            f"the start does not stay where the layout puts it: it moves by {off:.2g} m and {turned:.2g} rad"
        )
