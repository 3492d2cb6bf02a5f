"""What actions do."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from causalbench.conformance.bench import Bench, expect
from causalbench.conformance.moves import (
    ANGLE_ERROR,
    AXES,
    POSITION_ERROR,
    accepts,
    act,
    clear_start,
    draws,
    full_runs,
    grasp,
    moved,
    row,
    start,
    steps,
    to_base,
    walk,
)
from causalbench.core.numerics import rotations
from causalbench.core.tasks import pure_manipulation_data as numbers
from causalbench.core.world.layout import Layout
from causalbench.core.world.scene import Scene
from causalbench.errors import InvalidActionError

OWN_AXIS, CROSS_TALK = 0.10, 0.05  # of the declared amount
GRAVITY, GRAVITY_ERROR = 9.81, 0.05  # m/s^2, share
FLOOR_MARGIN, RELEASED = 0.08, 0.03  # m above the floor, m below the place of release: what is free fall in between


def s13_translations(bench: Bench) -> None:
    """S13. One second of full armx, army or armz, either way, moves the hand as declared along its base axis.

    Mean of five poses that leave room for it: within 10% along the own axis, at most 5% along or about the others.
    """
    for name in AXES[:3]:
        for value in (1.0, -1.0):
            _own_axis(bench.scene, name, value)


def s14_rotations(bench: Bench) -> None:
    """S14. One second of full armrx, armry or armrz, either way, turns the hand as declared about its own axis.

    Mean of five poses that leave room for it: within 10% about the own axis, at most 5% along or about the others.
    """
    for name in AXES[3:]:
        for value in (1.0, -1.0):
            _own_axis(bench.scene, name, value)


def _own_axis(scene: Scene, name: str, value: float) -> None:
    index, count = AXES.index(name), steps(scene, 1.0)
    declared = value * scene.spec.action_speed[scene.spec.actions.index(name)] * count * scene.spec.control_dt
    found = [moved(run[0], run[-1]) for run in full_runs(scene, name, value)]
    mean = np.mean(found, axis=0)
    what = f"{count} steps of {name} at {value:+g} from 5 poses"
    expect(
        abs(mean[index] - declared) <= OWN_AXIS * abs(declared),
        f"{what}: the mean along its own axis is {mean[index]:+.4f}, declared {declared:+.4f} (m or rad)",
    )
    cross = np.delete(np.abs(found).mean(axis=0), index)
    worst = int(cross.argmax())
    expect(
        cross[worst] <= CROSS_TALK * abs(declared),
        f"{what}: cross-talk into {np.delete(AXES, index)[worst]} is {cross[worst]:.4f} on average, more than "
        f"{CROSS_TALK:.0%} of the declared {abs(declared):.4f} (m or rad)",
    )


def s15_grip(bench: Bench) -> None:
    """S15. grip > 0 closes and < 0 opens at the declared speed, down to 3 mm and back to 98% of `max_opening`."""
    scene, widest = bench.scene, bench.spec.max_opening
    clear_start(scene)
    speed = 0.5 * scene.spec.action_speed[scene.spec.actions.index("grip")]
    count = max(2, int(0.8 * widest / (speed * scene.spec.control_dt)))
    declared = speed * count * scene.spec.control_dt
    before = float(scene.facts().gripper_opening)
    expect(before > 0.98 * widest, f"a start with open gripper has opening {before:.4f} m of {widest:.4f} m")
    closed = before - float(act(scene, count, grip=0.5).gripper_opening)
    expect(
        abs(closed - declared) <= OWN_AXIS * declared,
        f"{count} steps of grip at +0.5 close the gripper by {closed:+.4f} m, declared {declared:+.4f} m",
    )
    opened = closed - before + float(act(scene, count, grip=-0.5).gripper_opening)
    expect(
        abs(opened - declared) <= OWN_AXIS * declared,
        f"{count} steps of grip at -0.5 open the gripper by {opened:+.4f} m, declared {declared:+.4f} m",
    )
    shut = float(act(scene, steps(scene, 1.5), grip=1.0).gripper_opening)
    expect(shut < 3e-3, f"after 1.5 s of closing the gripper is still open by {shut:.4f} m")
    opened = float(act(scene, steps(scene, 1.5), grip=-1.0).gripper_opening)
    expect(opened > 0.98 * widest, f"opened all the way the gripper is at {opened:.4f} m of {widest:.4f} m")


def s16_base(bench: Bench) -> None:
    """S16. One second of forward or turn at half speed, either way, moves the base as declared and in no other way.

    Within 10% along the own axis, at most 5% across. Backwards first: the table is in front.
    """
    scene, count = bench.scene, steps(bench.scene, 1.0)
    for index, name in enumerate(("forward", "turn")):
        clear_start(scene)
        for value in (-0.5, 0.5):
            before = scene.facts().base_pose
            speed = scene.spec.action_speed[scene.spec.actions.index(name)]
            declared = value * speed * count * scene.spec.control_dt
            after = act(scene, count, **{name: value}).base_pose
            way = np.append(after[:2] - before[:2], 0.0)
            x, y, _ = rotations.rotate(rotations.from_axis_angle(2, -before[2]), way)
            found = np.array([x, math.remainder(after[2] - before[2], math.tau), y])
            what = f"{count} steps of {name} at {value:+g} move the base by {found} (x, yaw, y), not {declared:+.4f}"
            expect(abs(found[index] - declared) <= OWN_AXIS * abs(declared), what)
            expect(np.abs(np.delete(found, index)).max() <= CROSS_TALK * abs(declared), f"{what} in {name} alone")


def s17_half(bench: Bench) -> None:
    """S17. Half an action moves the hand half as far (armx, army, armz: 45% to 55% of the full action's way)."""
    for index, name in enumerate(AXES[:3]):
        full, half = (
            np.mean([moved(run[0], run[-1])[index] for run in full_runs(bench.scene, name, 1.0, size)])
            for size in (1.0, 0.5)
        )
        expect(0.45 <= half / full <= 0.55, f"{name} at 0.5 goes {half:.4f} m in a second, at 1.0 {full:.4f} m")


def s18_one_control_dt(bench: Bench) -> None:
    """S18. Every step is one `control_dt`: under full army each step after the third covers the same way within 15%."""
    scene = bench.scene
    for run in full_runs(scene, "army", 1.0, count=2):
        hand = [facts.eef_position for facts in run]
        way = np.diff([to_base(position)[1] for position in hand])[3:]
        expect(
            np.abs(way - way.mean()).max() <= 0.15 * abs(way.mean()),
            f"steps of the same action move the hand by unequal amounts (m): {np.round(way, 4)}",
        )


def s19_idle(bench: Bench) -> None:
    """S19. 0 is not executed: 20 idle steps move hand, base and box at most 1 mm and 0.5 degrees."""
    scene = bench.scene
    for seed in range(5):
        start(scene, seed)
        before = scene.facts()
        after = act(scene, 20)
        for name in ("eef", "object"):
            drift = float(np.linalg.norm(getattr(after, f"{name}_position") - getattr(before, f"{name}_position")))
            turn = float(
                rotations.angle_between(getattr(before, f"{name}_quaternion"), getattr(after, f"{name}_quaternion"))
            )
            expect(
                drift <= POSITION_ERROR and turn <= ANGLE_ERROR,
                f"20 idle steps move facts.{name}_* by {1e3 * drift:.2f} mm and {math.degrees(turn):.2f} degrees",
            )
        base = float(np.abs(after.base_pose - before.base_pose).max())
        expect(base <= POSITION_ERROR, f"20 idle steps move the base by {base:.4f} (m or rad)")


def s20_grip_zero(bench: Bench) -> None:
    """S20. grip 0 keeps opening and force: a half-open gripper stays within 1 mm, a held box stays held for 3 s."""
    scene = bench.scene
    clear_start(scene)
    speed = scene.spec.action_speed[scene.spec.actions.index("grip")]
    act(scene, steps(scene, 0.5 * scene.spec.max_opening / speed), grip=1.0)
    before = float(act(scene, steps(scene, 0.3)).gripper_opening)  # servos may still be arriving
    after = float(act(scene, 20).gripper_opening)
    expect(abs(after - before) <= 1e-3, f"20 idle steps change a half-open gripper from {before:.4f} to {after:.4f} m")
    grasp(scene)
    before = float(act(scene, steps(scene, 0.3), grip=1.0).gripper_opening)
    for _ in range(steps(scene, 3.0)):
        facts = act(scene, 1)
        expect(facts.holding, "a held box is no longer held while grip is 0: keep the force, not only the opening")
    after = float(facts.gripper_opening)
    expect(
        abs(after - before) <= 1e-3, f"with a held box 3 idle seconds change the opening: {before:.4f}, {after:.4f} m"
    )


def s21_gravity(bench: Bench) -> None:
    """S21. A released box falls with g within 5%, measured in steps of `control_dt`: seconds and metres are real."""
    scene = bench.scene
    for layout in draws(scene, 0, 4):
        if accepts(scene, _narrow_table(layout)):
            break
    outwards = -math.copysign(0.5, to_base(layout.target.position)[1])
    act(scene, steps(scene, 1.0), grip=1.0)
    expect(scene.facts().holding, "a second of closing did not grasp the box, so it cannot be dropped")
    act(scene, steps(scene, 2.0), armz=0.5)
    facts = act(scene, steps(scene, 2.0), army=outwards)
    expect(facts.holding, "the box was lost on the way to the place where it is to be dropped")
    top = float(facts.object_position[2])
    heights = [float(act(scene, 1, grip=-1.0).object_position[2]) for _ in range(steps(scene, 1.5))]
    free = np.array([z for z in heights if FLOOR_MARGIN < z < top - RELEASED])
    expect(
        len(free) >= 3,
        f"no three steps of free fall from {top:.2f} m to the floor; heights (m): {np.round(heights, 3)}",
    )
    found = -np.diff(free, 2) / scene.spec.control_dt**2
    expect(
        np.abs(found - GRAVITY).max() <= GRAVITY_ERROR * GRAVITY,
        f"a released box falls with {np.round(found, 2)} m/s^2 instead of {GRAVITY}: is a step one control_dt?",
    )


def _narrow_table(layout: Layout) -> Layout:
    """`layout` with a table that ends 0.1 m beside the box."""
    table = layout.fixtures[0]
    x, _, z = to_base(table.position)
    place = rotations.rotate(numbers.BASE_QUATERNION, np.array([x, to_base(layout.target.position)[1], z]))
    narrow = dataclasses.replace(table, position=place, half_extents=table.half_extents * np.array([1.0, 0.2, 1.0]))
    return dataclasses.replace(layout, fixtures=(narrow,))


def s22_invalid_actions(bench: Bench) -> None:
    """S22. NaN, infinity, a wrong shape or a value outside [-1, 1] raises `InvalidActionError` and moves nothing."""
    scene, n = bench.scene, len(bench.spec.actions)
    start(scene, 0)
    snapshot = scene.snapshot()
    expected = walk(scene, 0, 3)
    scene.restore(snapshot)
    before = row(scene.facts())
    bad = [("a wrong shape", np.zeros(shape)) for shape in ((n - 1,), (n + 1,), (1, n))]
    for index in (0, n - 1):
        for value in (np.nan, np.inf, 1.5, -1.5):
            action = np.full(n, 0.5)
            action[index] = value
            bad.append((str(value), action))
    for what, action in bad:
        try:
            scene.step(action)
        except InvalidActionError:
            continue
        except Exception as error:
            raise AssertionError(f"an action with {what} raised {type(error).__name__}: {error}") from error
        raise AssertionError(f"an action with {what} was executed; see `causalbench.core.world.scene.check_action`")
    expect(np.array_equal(row(scene.facts()), before), "a refused action changed the facts")
    off = np.abs(walk(scene, 0, 3) - expected).max()
    expect(off < POSITION_ERROR, f"after refused actions the same steps end elsewhere, by up to {off:.2g}")


def s23_finite(bench: Bench) -> None:
    """S23. During 200 random actions facts stay finite, the hand near the base and the box above the floor."""
    scene = bench.scene
    for seed in range(2):
        start(scene, seed)
        facts = walk(scene, seed, 200)
        expect(
            np.isfinite(facts).all(), f"facts are not finite after step {1 + int(np.isfinite(facts).all(1).argmin())}"
        )
        last = scene.facts()
        reach = float(np.linalg.norm(last.eef_position[:2] - last.base_pose[:2]))
        expect(reach < 3, f"after 200 random actions the hand is {reach:.1f} m from the base")
        height = float(last.object_position[2])
        expect(-0.1 < height < 5, f"after 200 random actions the box is at a height of {height:.1f} m")
