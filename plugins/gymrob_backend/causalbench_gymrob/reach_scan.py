"""Where Fetch can start: `python -m causalbench_gymrob.reach_scan` prints the scan behind Fetch's `WORKSPACE`.

The rule: a box may stand wherever its hover pose (tilted or not) and its face-down grasp are all reachable. The hand
starts clear of the box, as far out as leaves at least half of the tilted postures reachable on each face, and no
higher than the upper arm stays clear of the head on the way down.
Then starts are drawn for real, and counted: how many are refused, and how many lie on the reach limit.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from causalbench.core import arm_ik, rotations
from causalbench.core.fetch import ACTIONS, ARM_STARTS, WORKSPACE
from causalbench.core.tasks import pure_manipulation as task
from causalbench.errors import UnreachableLayoutError
from causalbench_gymrob.scene import GymrobScene
from causalbench_gymrob.world import World

Array = NDArray[np.float64]

PUSHES = 5  # full steps of armx by which a start is tried for the reach limit
SHORT = 0.5  # it is at the limit if they bring the hand less than this share of the way
BENT = 0.05  # and its height depends on armx if they change it by this share of the way
FACE_POINTS = 7  # per side of the grid on a face of the hand's box
TILTED = [(pitch, roll) for pitch in (task.TILT_LOW, 0.675, task.TILT_HIGH) for roll in (-task.ROLL, 0.0, task.ROLL)]
_SLANT = task.TOLERANCE_ORI / math.sqrt(2)
FACE_DOWN = [(pitch, roll) for pitch in (-_SLANT, 0.0, _SLANT) for roll in (-_SLANT, 0.0, _SLANT)]


def posture(pitch: float, roll: float) -> Array:
    """Rotation matrix (3, 3) in the base frame of a hand that points `pitch` rad forward of straight down."""
    tilted = rotations.multiply(task.FACE_DOWN, rotations.from_axis_angle(1, -pitch))
    return rotations.matrix(rotations.multiply(tilted, rotations.from_axis_angle(0, roll)))


def joints(world: World, position: Iterable[float], pitch: float, roll: float) -> Array | None:
    """Joint angles (7,) of a pose in the base frame, None if it is out of reach."""
    try:
        return arm_ik.solve(world.chain, np.array([*position]), posture(pitch, roll), ARM_STARTS)
    except UnreachableLayoutError:
        return None


def reachable(world: World, position: Iterable[float], tilts: list[tuple[float, float]]) -> float:
    """Share of `tilts` (pitch, roll) that the hand can take at `position` (3,)."""
    position = tuple(position)
    return float(np.mean([joints(world, position, *tilt) is not None for tilt in tilts]))


def serves_object(world: World, x: float, y: float) -> bool:
    """Whether a box at (x, y) can be hovered over, tilted or not, and grasped face down, at all tolerated offsets."""
    box_z = WORKSPACE.table_height + task.BOX_HALF_EXTENTS[2]
    for dx in (-task.TOLERANCE_XY, task.TOLERANCE_XY):
        for dy in (-task.TOLERANCE_XY, task.TOLERANCE_XY):
            for height in (task.HOVER - task.TOLERANCE_HOVER, task.HOVER + task.TOLERANCE_HOVER):
                if reachable(world, (x + dx, y + dy, box_z + height), TILTED + FACE_DOWN) < 1.0:
                    return False
            if reachable(world, (x + dx, y + dy, box_z + task.GRASP_HEIGHT), FACE_DOWN) < 1.0:
                return False
    return True


def faces(low: tuple[float, ...], high: tuple[float, ...]) -> Iterator[tuple[str, list[tuple[float, ...]]]]:
    """Each face of a box with a grid of points on it."""
    for axis in range(3):
        for side, value in (("low", low[axis]), ("high", high[axis])):
            spans = [np.array([value]) if i == axis else np.linspace(low[i], high[i], FACE_POINTS) for i in range(3)]
            points = np.stack(np.meshgrid(*spans, indexing="ij"), -1).reshape(-1, 3)
            yield f"{side} {'xyz'[axis]}", [tuple(point) for point in points.tolist()]


def draw_starts(scene: GymrobScene, count: int, seed: int = 0) -> dict[str, float]:
    """Shares of `count` drawn starts of stage 1: refused by cause; at the reach limit, among the accepted."""
    rng = np.random.default_rng(seed)
    refused = dict.fromkeys(("out of reach or not at rest", "in contact", "in another stage"), 0)
    short = bent = 0
    for _ in range(count):
        try:
            scene.reset(task.draw_layout(rng, scene.spec.workspace, scene.spec.max_opening, 1))
        except UnreachableLayoutError:
            refused["out of reach or not at rest"] += 1
            continue
        facts = scene.facts()
        if facts.collision_arm or facts.collision_self or facts.collision_base:
            refused["in contact"] += 1
        elif task.stage(facts) != 1:
            refused["in another stage"] += 1
        else:
            forward, up = _push(scene)
            short += forward < SHORT
            bent += abs(up) > BENT
    accepted = count - sum(refused.values())
    shares = {name: value / count for name, value in refused.items()} | {"accepted": accepted / count}
    return shares | {"at the reach limit": short / accepted, "armx changes height": bent / accepted}


def _push(scene: GymrobScene) -> tuple[float, float]:
    """How far forward and up the hand goes under `PUSHES` full steps of armx, as shares of the commanded way."""
    action = np.zeros(len(ACTIONS))
    action[0] = 1.0
    before = scene.facts()
    for _ in range(PUSHES):
        scene.step(action)
    way = PUSHES * scene.spec.action_speed[0] * scene.spec.control_dt
    moved = (scene.facts().eef_position - before.eef_position) / way
    yaw = before.base_pose[2]
    return float(np.cos(yaw) * moved[0] + np.sin(yaw) * moved[1]), float(moved[2])


def main(count: int = 2000) -> None:
    """Print the scan."""
    say = sys.stdout.write
    world = World(0.005, n_fixtures=1)
    say("tilted hand: share of reachable postures; rows z, columns x from 0.50 by 0.05\n")
    for y in (0.0, 0.2):
        say(f"y = {y}\n")
        for z in np.arange(1.20, 0.69, -0.05):
            row = [reachable(world, (x, y, z), TILTED) for x in np.arange(0.50, 1.06, 0.05)]
            say(f"{z:.2f} " + " ".join(f"{share:4.2f}" for share in row) + "\n")
    say("box: X where hover and grasp are reachable throughout; rows x, columns y from -0.30 by 0.05\n")
    for x in np.arange(0.56, 0.83, 0.02):
        say(f"{x:.2f} " + "".join(".X"[serves_object(world, x, y)] for y in np.arange(-0.30, 0.31, 0.05)) + "\n")
    say("declared hand box: reachable share of each face\n")
    for name, points in faces(WORKSPACE.hand_low, WORKSPACE.hand_high):
        say(f"{name:7} {np.mean([reachable(world, point, TILTED) for point in points]):.2f}\n")
    say(f"{count} drawn starts\n")
    for name, share in draw_starts(GymrobScene(), count).items():
        say(f"{name:28} {share:.3f}\n")


if __name__ == "__main__":
    main()
