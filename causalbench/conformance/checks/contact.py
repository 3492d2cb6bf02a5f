"""What facts say about contact."""

from __future__ import annotations

import dataclasses
from itertools import islice

import numpy as np

from causalbench.conformance.bench import Bench, expect
from causalbench.conformance.moves import (
    AXES,
    Unfit,
    accepts,
    act,
    clear_poses,
    clear_start,
    draws,
    grasp,
    press,
    start,
    steps,
)
from causalbench.core.numerics import rotations
from causalbench.core.world.scene import Scene


def s24_collision(bench: Bench) -> None:
    """S24. `collision_arm` is true while the hand is driven into the table, and false once it has left it."""
    scene = bench.scene
    facts = press(scene)
    expect(
        any(f.collision_arm for f in facts[-3:]),
        "the hand was driven down into the table, but collision_arm is false. Does the hand stop at all? Its height "
        f"in the last steps (m): {[round(float(f.eef_position[2]), 3) for f in facts[-3:]]}",
    )
    low = float(facts[-1].eef_position[2])
    table = scene.spec.workspace.table_height
    expect(low > table - 0.02, f"the hand is {table - low:.3f} m inside the table")
    left = act(scene, steps(scene, 0.7), armz=1.0)
    rise = float(left.eef_position[2]) - low
    expect(rise > 0.05, f"0.7 s of armz off the table raise the hand by {rise:.3f} m only: targets wind up")
    expect(not left.collision_arm, f"collision_arm is still true {rise:.3f} m above the table")


def s25_clear(bench: Bench) -> None:
    """S25. No collision is reported in clear space."""
    scene = bench.scene
    accepted = (layout for layout in clear_poses(scene) if accepts(scene, layout))
    for _ in islice(accepted, 5):
        for name in AXES:
            for value in (0.3, -0.3):
                facts = act(scene, 2, **{name: value})
                flags = {n: bool(getattr(facts, n)) for n in ("collision_base", "collision_arm", "collision_self")}
                expect(not any(flags.values()), f"small motions ({name}) above the table report a collision: {flags}")


def s26_holding(bench: Bench) -> None:
    """S26. `holding` is true for a grasp and false for an open hand around the box and for one closed on nothing."""
    scene = bench.scene
    for seed in range(3):
        start(scene, seed, 4)
        expect(not act(scene, 2).holding, "holding is true while the open hand is around the box")
        grasp(scene, seed)
        act(scene, steps(scene, 2.0), grip=1.0)  # squeezing must wind nothing up
        expect(not act(scene, steps(scene, 1.0), grip=-1.0).holding, "holding is still true after a second of opening")
    clear_start(scene)
    expect(not act(scene, steps(scene, 1.5), grip=1.0).holding, "holding is true for a hand closed on nothing")


ASIDE = (0.03, 0.025)  # m along the hand's x and y: within the box's half length, and within the open gripper
ABOVE = 0.04  # m that the point between the pads may be above the table when the fingers touch it


def s53_hand_in_the_world(bench: Bench) -> None:
    """S53. The hand is where the scene says: it grasps a box that lies up to 3 cm to any side, and stops at the table.

    The box lies 3 cm off along the hand's x, 2.5 cm along its y, to either side; a hand that is elsewhere misses one.
    Driven down, it comes to rest with the fingers on the table, at most 4 cm below the point that is reported.
    """
    scene = bench.scene
    for axis, distance in enumerate(ASIDE):
        for off in (distance, -distance):
            _put_aside(scene, axis, off)
            for _ in range(steps(scene, 2.0)):
                if act(scene, 1, grip=1.0).holding:
                    break
            expect(
                scene.facts().holding,
                f"a box {off:+.3f} m along the hand's {'xy'[axis]} is not grasped, as if the hand were elsewhere than "
                "facts say",
            )
    low = min(float(facts.eef_position[2]) for facts in press(scene))
    above = low - scene.spec.workspace.table_height
    expect(
        above < ABOVE, f"driven down, the hand stops {above:.3f} m above the table, as if it were lower than it says"
    )


FOLDS: tuple[dict[str, float], ...] = (
    {"armx": -1.0, "armry": -1.0},
    {"armx": -1.0, "armry": 1.0},
    {"armx": -1.0, "armz": 1.0},
    {"armx": -1.0, "armz": -0.3},
    {"armry": 1.0},
)
"""What folds an arm against itself or its base: actions, each held for some seconds."""
FOLD_SECONDS = 4.0


def s54_self_collision(bench: Bench) -> None:
    """S54. `collision_self` is true while the robot is folded against itself, and false once it has come back.

    From where S25 starts, `armx` towards the base with a turn about the hand's y or a way up or down, for at most 4 s:
    one of five such ways must do it. Then the same way back. A robot of one piece has nothing of its own to touch: say
    so as a known gap.
    """
    scene = bench.scene
    for fold in FOLDS:
        clear_start(scene)
        for count in range(1, steps(scene, FOLD_SECONDS)):
            if act(scene, 1, **fold).collision_self:
                back = act(scene, count, **{name: -value for name, value in fold.items()})
                expect(
                    not back.collision_self, f"collision_self is still true {count} steps of the way back after {fold}"
                )
                return
    raise AssertionError(
        f"collision_self stays false in {FOLD_SECONDS:.0f} s of each of {FOLDS}. Can links of the robot pass "
        "through one another? If there are none that could touch: a known gap"
    )


def _put_aside(scene: Scene, axis: int, off: float) -> None:
    """An open hand face down at grasp height, the box on the table `off` from below it along the hand's `axis`."""
    unfit = Unfit()
    for layout in draws(scene, 0, 4):
        box = layout.target.position
        hand = np.append(box[:2], layout.eef_position[2])
        way = rotations.rotate(layout.eef_quaternion, np.eye(3)[axis])
        way[2] = 0.0
        target = dataclasses.replace(layout.target, position=box + off * way / np.linalg.norm(way))
        opened = dataclasses.replace(layout, eef_position=hand, target=target, gripper_opening=scene.spec.max_opening)
        if unfit.serves(scene, opened) and unfit.free(scene.facts()):
            return
    raise AssertionError(f"an open hand around a box {off:+.3f} m along its {'xy'[axis]} is never accepted: {unfit}")
