"""What a reset does."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from causalbench.conformance.bench import Bench, expect
from causalbench.conformance.moves import (
    ANGLE_ERROR,
    POSITION_ERROR,
    Unfit,
    accepts,
    act,
    contacts,
    draws,
    row,
    start,
)
from causalbench.core.numerics import rotations
from causalbench.core.tasks.pure_manipulation_data import N_STAGES, C
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Box, Layout

ELSEWHERE = (0.4, -0.3, 0.7)
"""Another place for the robot's base: x m, y m, yaw rad."""
DRAWS = 40


def s09_layout(bench: Bench) -> None:
    """S9. Reset puts hand, box, base and opening where the layout says, within 1 mm and 0.5 degrees, and at rest.

    20 starts of all stages; the scene keeps the layout as `layout`. Quaternions are (w, x, y, z) and turn the
    body's axes into the world's.
    """
    for stage in range(1, N_STAGES + 1):
        for seed in range(5):
            layout = start(bench.scene, seed, stage)
            expect(bench.scene.layout is layout, "scene.layout is not the one that reset was given: keep it there")
            _compare(bench.scene.facts(), layout, f"after reset (stage {stage}, seed {seed})")
            facts = act(bench.scene, 2)
            _compare(facts, layout, f"two idle steps after reset (stage {stage}, seed {seed}): is the start at rest?")


def _compare(facts: Facts, layout: Layout, when: str) -> None:
    for name, position, asked in (
        ("hand", facts.eef_position, layout.eef_position),
        ("box", facts.object_position, layout.target.position),
    ):
        off = float(np.linalg.norm(position - asked))
        expect(off < POSITION_ERROR, f"the {name} is {1e3 * off:.2f} mm from where the layout puts it {when}")
    for name, posture, asked in (
        ("hand", facts.eef_quaternion, layout.eef_quaternion),
        ("box", facts.object_quaternion, layout.target.quaternion),
    ):
        off = float(rotations.angle_between(posture, asked))
        hint = _order_hint(posture, asked) if off > ANGLE_ERROR else ""
        expect(off < ANGLE_ERROR, f"the {name} is turned by {np.degrees(off):.2f} degrees {when}{hint}")
    off = float(np.abs(facts.base_pose - layout.base_pose).max())
    expect(off < POSITION_ERROR, f"the base is at {facts.base_pose}, the layout says {layout.base_pose} {when}")
    off = float(facts.gripper_opening) - layout.gripper_opening
    expect(abs(off) < POSITION_ERROR, f"the gripper's opening is off by {1e3 * off:+.2f} mm {when}")


def _order_hint(found: NDArray[np.float64], asked: NDArray[np.float64]) -> str:
    if rotations.angle_between(found[[3, 0, 1, 2]], asked) < ANGLE_ERROR:
        return "; it would fit if read as (x, y, z, w): the order is (w, x, y, z)"
    if rotations.angle_between(rotations.conjugate(found), asked) < ANGLE_ERROR:
        return "; it would fit if inverted: the quaternion turns the body's axes into the world's"
    return ""


def s10_base_elsewhere(bench: Bench) -> None:
    """S10. With the base elsewhere a start looks the same from the base, within 1 mm and 0.5 degrees."""
    scene = bench.scene
    for seed in range(5):
        layout = start(scene, seed)
        here = scene.facts()
        expect(
            accepts(scene, _moved_base(layout)),
            f"reset refuses a start (seed {seed}) that it accepted, once base, table, box and hand are moved together",
        )
        there = scene.facts()
        expect(
            np.abs(there.base_pose - ELSEWHERE).max() < POSITION_ERROR,
            f"facts.base_pose is {there.base_pose}, the layout says {ELSEWHERE}",
        )
        turn = _turn()
        for name in ("eef", "object"):
            found, expected = getattr(there, f"{name}_position"), _place(getattr(here, f"{name}_position"))
            off = float(np.linalg.norm(found - expected))
            expect(
                off < POSITION_ERROR, f"with the base moved, {name}_position is {1e3 * off:.2f} mm off (seed {seed})"
            )
            posture = rotations.multiply(turn, getattr(here, f"{name}_quaternion"))
            angle = float(rotations.angle_between(getattr(there, f"{name}_quaternion"), posture))
            expect(angle < ANGLE_ERROR, f"with the base moved, {name}_quaternion is {angle:.4f} rad off (seed {seed})")


def _turn() -> NDArray[np.float64]:
    return rotations.from_axis_angle(2, ELSEWHERE[2] - C.base_yaw)


def _place(position: NDArray[np.float64]) -> NDArray[np.float64]:
    return rotations.rotate(_turn(), position) + np.array([*ELSEWHERE[:2], 0.0])


def _moved_base(layout: Layout) -> Layout:
    """The same start seen from the base, the base being at `ELSEWHERE`."""

    def box(old: Box) -> Box:
        posture = rotations.canonical(rotations.multiply(_turn(), old.quaternion))
        return dataclasses.replace(old, position=_place(old.position), quaternion=posture)

    return dataclasses.replace(
        layout,
        fixtures=tuple(box(fixture) for fixture in layout.fixtures),
        target=box(layout.target),
        base_pose=np.array(ELSEWHERE),
        eef_position=_place(layout.eef_position),
        eef_quaternion=rotations.canonical(rotations.multiply(_turn(), layout.eef_quaternion)),
    )


def s11_out_of_reach(bench: Bench) -> None:
    """S11. A pose that the arm cannot take raises `UnreachableLayoutError`, and the next reset works."""
    scene = bench.scene
    layout = start(scene, 0)
    before = row(scene.facts())
    far = dataclasses.replace(layout, eef_position=layout.eef_position + np.array([0.0, 5.0, 0.0]))
    expect(not accepts(scene, far), "a hand that shall start 5 m away was accepted: raise UnreachableLayoutError")
    scene.facts()  # an environment asks for them before it draws again
    expect(accepts(scene, layout), "a start that was accepted before is refused after one that was out of reach")
    off = np.abs(row(scene.facts()) - before).max()
    expect(off < POSITION_ERROR, f"a start after a refused one differs from the same start before it by {off:.2g}")


def s12_no_contact(bench: Bench) -> None:
    """S12. No start that reset accepts is in contact or holds the box, and it accepts at least half of 40 (stage 1).

    Starts are drawn again until one is accepted. In a workspace much larger than the reach that hides the mistake, and
    a seed would mean another start here than in other simulators.
    """
    bad, accepted, unfit = [], 0, Unfit()
    for number, layout in zip(range(DRAWS), draws(bench.scene, 0, 1), strict=False):
        if unfit.serves(bench.scene, layout):
            accepted += 1
            if contacts(bench.scene.facts()):
                bad.append(number)
    expect(2 * accepted >= DRAWS, f"reset accepted only {accepted} of {DRAWS} starts, half are needed: {unfit}")
    expect(not bad, f"{len(bad)} of {accepted} accepted starts are in contact (draws {bad}): refuse them in reset")
