"""A base that drives, its LiDAR and what it runs into. Starts come from the layouts of mobile manipulation."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from causalbench.conformance.bench import Bench, expect
from causalbench.conformance.moves import ANGLE_ERROR, POSITION_ERROR, accepts, act, contacts, start, steps
from causalbench.conformance.replay import check_restored
from causalbench.core.numerics import rotations
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks import rooms
from causalbench.core.tasks.mobile_manipulation import TASK
from causalbench.core.world import lidar
from causalbench.core.world.capabilities import Capability
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout, box_rows
from causalbench.core.world.scene import Scene

Array = NDArray[np.float64]

MAX_DRAWS = 50
SPEED_ERROR = 0.1  # of the declared amount
HAND_ERROR, HAND_TURN = 0.01, 0.05  # m, rad: by how much a carried hand may lag or swing
RANGE_ERROR = 1e-3  # m
EDGE_RAYS = 4  # of 220 that may differ where a ray passes the edge of a box
WALL = 0.80  # m from the wall at which the base starts to drive into it
INTO_WALL = 0.03  # m
FLAGS = ("collision_base", "collision_arm", "collision_self")


def _start(scene: Scene, seed: int, stage: int = 1) -> Layout:
    return start(scene, seed, stage, TASK, MAX_DRAWS)


def _speed(scene: Scene, name: str) -> float:
    return scene.spec.action_speed[scene.spec.actions.index(name)]


def _hand_in_base(facts: Facts) -> tuple[Array, Array]:
    """Position (3,) and quaternion (4,) of the hand in the base frame."""
    back = rotations.from_axis_angle(2, -facts.base_pose[2])
    origin = np.append(facts.base_pose[:2], 0.0)
    return rotations.rotate(back, facts.eef_position - origin), rotations.multiply(back, facts.eef_quaternion)


def s40_room(bench: Bench) -> None:
    """S40. In a furnished room hand, base and target are where the layout puts them, within 1 mm and 0.5 degrees.

    9 starts of all stages; a target of mass 0 stays there, and holds nothing, while the robot moves.
    """
    scene = bench.scene
    for stage in range(1, TASK.n_stages + 1):
        for seed in range(3):
            layout = _start(scene, seed, stage)
            facts = act(scene, 2)
            for name, found, asked in (
                ("hand", facts.eef_position, layout.eef_position),
                ("base", facts.base_pose, layout.base_pose),
                ("target", facts.object_position, layout.target.position),
            ):
                off = float(np.abs(found - asked).max())
                expect(off < POSITION_ERROR, f"the {name} is at {found}, the layout says {asked} (seed {seed})")
            angle = float(rotations.angle_between(facts.eef_quaternion, layout.eef_quaternion))
            expect(angle < ANGLE_ERROR, f"the hand is turned by {math.degrees(angle):.2f} degrees (seed {seed})")
            facts = act(scene, 3, turn=1.0, armz=0.5, grip=1.0)
            off = float(np.abs(facts.object_position - layout.target.position).max())
            expect(off < 1e-9 and not facts.holding, f"a target of mass 0 moved by {off:.2g} m or is held")


def s41_arc(bench: Bench) -> None:
    """S41. One second of forward and turn together drives an arc at the declared speeds, and the hand moves along.

    At half speed; way and turn within 10%, the hand within 10 mm and 0.05 rad of its place on the base.
    """
    scene, count = bench.scene, steps(bench.scene, 1.0)
    for value in (0.5, -0.5):
        _start(scene, 0)
        before = scene.facts()
        after = act(scene, count, forward=0.5, turn=value)
        expect(not contacts(after), "an arc of half a metre from a start of stage 1 runs into something")
        turned = value * _speed(scene, "turn") * count * scene.spec.control_dt
        chord = 0.5 * _speed(scene, "forward") * count * scene.spec.control_dt * math.sin(turned / 2) / (turned / 2)
        heading = before.base_pose[2] + turned / 2
        asked = np.array([chord * math.cos(heading), chord * math.sin(heading), turned])
        found = after.base_pose - before.base_pose
        found[2] = math.remainder(found[2], math.tau)
        expect(
            float(np.hypot(*(found - asked)[:2])) <= SPEED_ERROR * chord
            and abs(found[2] - turned) <= SPEED_ERROR * abs(turned),
            f"{count} steps of forward at +0.5 and turn at {value:+g} move the base by {found}, expected {asked}",
        )
        after = act(scene, steps(scene, 0.5))
        (position, posture), (new_position, new_posture) = _hand_in_base(before), _hand_in_base(after)
        off = float(np.linalg.norm(new_position - position))
        angle = float(rotations.angle_between(posture, new_posture))
        expect(
            off <= HAND_ERROR and angle <= HAND_TURN,
            f"after an arc and half an idle second the hand is {1e3 * off:.1f} mm and {angle:.3f} rad off its place "
            "on the base",
        )


def s42_base_velocity(bench: Bench) -> None:
    """S42. `base_velocity` is what the base does: within 10% of the declared speed on the way, 0 at rest."""
    scene = bench.scene
    for index, name in enumerate(("forward", "turn")):
        _start(scene, 1)
        rest = np.abs(scene.facts().base_velocity).max()
        expect(rest < 1e-2, f"at rest facts.base_velocity is {scene.facts().base_velocity}")
        for value in (0.5, -0.5):
            found = act(scene, steps(scene, 0.5), **{name: value}).base_velocity
            asked = np.zeros(2)
            asked[index] = value * _speed(scene, name)
            expect(
                np.abs(found - asked).max() <= SPEED_ERROR * abs(asked[index]),
                f"under {name} at {value:+g} facts.base_velocity is {found}, expected {asked}",
            )
        after = act(scene, steps(scene, 0.5))
        expect(np.abs(after.base_velocity).max() < 1e-2, f"half a second later it is {after.base_velocity}, not 0")


def s43_lidar(bench: Bench) -> None:
    """S43. The LiDAR gives 220 ranges over 220 degrees from right to left, those of the closed form within 1 mm.

    From `spec.lidar_position`, at starts in every room plan and after driving; of a base that stands, at starts of pure
    manipulation and after raising the hand. Rays past an edge may differ, 4 of 220.
    """
    scene = bench.scene
    drives = Capability.MOBILE_BASE in scene.spec.capabilities
    for seed in range(6):
        layout = _start(scene, seed) if drives else start(scene, seed)
        _compare_scan(scene, layout, f"(seed {seed})")
        act(scene, steps(scene, 0.5), **({"forward": 0.5, "turn": 0.7} if drives else {"armz": 0.5}))
        _compare_scan(scene, layout, f"half a second later (seed {seed})")


def s44_lidar_fixtures_only(bench: Bench) -> None:
    """S44. The LiDAR sees only fixtures, neither the robot nor the target; a ray that meets nothing gives 10 m."""
    scene = bench.scene
    layout = _start(scene, 0)
    position = scene.spec.lidar_position
    assert position is not None
    ahead = lidar.scanner_pose(layout.base_pose, (position[0] + 0.3, *position[1:]))[:3]
    target = dataclasses.replace(layout.target, position=ahead)
    for fixtures, what in ((layout.fixtures, "a target in front of the scanner"), (layout.fixtures[:1], "one wall")):
        changed = dataclasses.replace(layout, target=target, fixtures=fixtures)
        expect(accepts(scene, changed), f"reset refuses a start with {what}")
        _compare_scan(scene, changed, f"with {what}")


def _compare_scan(scene: Scene, layout: Layout, when: str) -> None:
    found = scene.lidar()
    expect(
        isinstance(found, np.ndarray) and found.shape == (lidar.N_RAYS,) and found.dtype == np.float64,
        f"lidar() returned {type(found).__name__} {np.shape(found)}, expected float64 ({lidar.N_RAYS},)",
    )
    expect(np.isfinite(found).all(), f"lidar() is not finite {when}; a ray that meets nothing says {lidar.MAX_RANGE}")
    assert scene.spec.lidar_position is not None
    pose = lidar.scanner_pose(scene.facts().base_pose, scene.spec.lidar_position)
    asked = lidar.scan(box_rows(layout.fixtures), pose)
    wrong = np.flatnonzero(np.abs(found - asked) > RANGE_ERROR)
    hint = "; reversed it would fit: from right to left" if np.abs(found[::-1] - asked).max() < RANGE_ERROR else ""
    expect(
        len(wrong) <= EDGE_RAYS,
        f"{len(wrong)} of {lidar.N_RAYS} rays differ from the closed form {when}, such as ray {wrong[:1]}: "
        f"{found[wrong[:1]]} m, expected {asked[wrong[:1]]} m{hint}",
    )


def _at_wall(scene: Scene) -> None:
    """Put the base into a room without furniture, its back to the west wall."""
    layout = _start(scene, 0)
    walls = rooms.fixtures(0)[:4]
    pose = np.array([-rooms.ROOM_HALF_EXTENTS[0] + WALL, 0.0, 0.0])
    turn = rotations.from_axis_angle(2, pose[2] - layout.base_pose[2])
    hand = layout.eef_position - np.append(layout.base_pose[:2], 0.0)
    there = dataclasses.replace(
        layout,
        fixtures=walls,
        base_pose=pose,
        eef_position=rotations.rotate(turn, hand) + np.append(pose[:2], 0.0),
        eef_quaternion=rotations.canonical(rotations.multiply(turn, layout.eef_quaternion)),
    )
    expect(accepts(scene, there), f"reset refuses a base {WALL} m in front of a wall: {there.base_pose}")
    expect(not contacts(scene.facts()), f"a base {WALL} m in front of a wall is in contact")


def _drive_into_wall(scene: Scene) -> list[Facts]:
    """Drive backwards for as long as the way to the wall takes, and a second on; facts after every step."""
    _at_wall(scene)
    seconds = WALL / _speed(scene, "forward") + 1.0
    return [act(scene, 1, forward=-1.0) for _ in range(steps(scene, seconds))]


def s45_base_collision(bench: Bench) -> None:
    """S45. `collision_base` is true while the base is driven into a wall, which stops it, and false once it has left.

    The base goes at most 30 mm into the wall while it pushes; 0.7 s of full forward take it off the wall.
    """
    scene = bench.scene
    run = _drive_into_wall(scene)
    x = np.array([facts.base_pose[0] for facts in run])
    expect(
        any(facts.collision_base for facts in run[-5:]),
        f"the base was driven into a wall, but collision_base is false; its way to the wall (m): {np.round(x[-5:], 3)}",
    )
    first = next(i for i, facts in enumerate(run) if facts.collision_base)
    expect(x[first] < x[0] - 0.1, "collision_base is true 0.1 m before the base can have reached the wall")
    expect(x[first] - x.min() <= INTO_WALL, f"the base goes {x[first] - x.min():.3f} m on into the wall")
    left = act(scene, steps(scene, 0.7), forward=1.0)
    way = float(left.base_pose[0] - x[-1])
    expect(way > 0.2, f"0.7 s of forward take the base {way:.3f} m off the wall: targets wind up")
    expect(not left.collision_base, f"collision_base is still true {way:.3f} m off the wall")


def s46_snapshot_drive(bench: Bench) -> None:
    """S46. A snapshot that is taken while the base drives or pushes against a wall continues in the same way, too."""
    scene = bench.scene
    _start(scene, 2)
    act(scene, steps(scene, 0.5), forward=0.7, turn=-0.6)
    check_restored(bench, "driving")
    _drive_into_wall(scene)
    check_restored(bench, "pushing against a wall")


def s47_mobile_expert(bench: Bench) -> None:
    """S47. The scripted expert brings the hand to the target from 5 starts of stage 1 and collides with nothing."""
    worlds = SceneWorlds(TASK, bench.scene)
    for seed in range(5):
        worlds.reset([0], [np.random.default_rng(seed)], 1)
        where = _drive_to_target(worlds)
        expect(not where, f"the scripted expert (seed {seed}): {where}; the base is at {worlds.facts.base_pose}")


def _drive_to_target(worlds: SceneWorlds) -> str:
    """Let the scripted expert act; "" for success, else what went wrong."""
    for _ in range(TASK.horizon):
        step = worlds.step(worlds.expert())
        if step.success:
            return ""
        if touched := [name for name in FLAGS if getattr(worlds.facts, name)]:
            return f"{', '.join(touched)} in stage {step.stage}"
    return f"not there after {TASK.horizon} steps"
