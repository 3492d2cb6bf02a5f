"""Where a robot can start: the scan behind a plugin's `WORKSPACE`, which its `reach_scan` module prints.

The rule: a box may stand wherever all poses that the task demands around it are reachable. The hand starts clear of the
box, as far out as leaves at least half of the tilted postures reachable on each face of its box. Then starts are drawn
for real, and counted: how many are refused, and how many lie on the reach limit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from causalbench.core.kit import arm_ik
from causalbench.core.numerics import rotations
from causalbench.core.world.layout import Workspace
from causalbench.core.world.reach import ReachDemands, Tilts
from causalbench.core.world.scene import Scene
from causalbench.errors import UnreachableLayoutError

Array = NDArray[np.float64]
Point = tuple[float, ...]

PUSHES = 5  # full steps of armx by which a start is tried for the reach limit
SHORT = 0.5  # it is at the limit if they bring the hand less than this share of the way
BENT = 0.05  # and its height depends on armx if they change it by this share of the way
FACE_POINTS = 7  # per side of the grid on a face of the hand's box
AROUND = 0.15  # m around the declared boxes that the printed maps show


@dataclass(frozen=True)
class Arm:
    """An arm: its chain in the base frame, where solutions are searched from, and which of them may be used."""

    chain: arm_ik.Chain
    starts: tuple[Array, ...]
    usable: Callable[[Array], bool] = lambda joints: True

    def reachable(self, position: Point, tilts: Tilts) -> float:
        """Share of `tilts` (pitch, roll) that the hand can take at `position` (3,) m in the base frame."""
        return float(np.mean([self._takes(position, *tilt) for tilt in tilts]))

    def _takes(self, position: Point, pitch: float, roll: float) -> bool:
        try:
            return self.usable(arm_ik.solve(self.chain, np.array(position), posture(pitch, roll), self.starts))
        except UnreachableLayoutError:
            return False

    def serves(self, x: float, y: float, table_height: float, demands: ReachDemands) -> bool:
        """Whether all that is demanded around a box at (x, y) on a table is reachable; metres, base frame."""
        z, off = table_height + demands.rise, demands.offset
        return all(
            self.reachable((x + dx, y + dy, z + height), tilts) == 1.0
            for dx in (-off, off)
            for dy in (-off, off)
            for height, tilts in demands.poses
        )


def posture(pitch: float, roll: float) -> Array:
    """Rotation matrix (3, 3) in the base frame of a hand that points `pitch` rad forward of straight down."""
    tilted = rotations.multiply(rotations.FACE_DOWN, rotations.from_axis_angle(1, -pitch))
    return rotations.matrix(rotations.multiply(tilted, rotations.from_axis_angle(0, roll)))


def faces(low: Point, high: Point) -> Iterator[tuple[str, list[Point]]]:
    """Each face of a box with a grid of points on it."""
    for axis in range(3):
        for side, value in (("low", low[axis]), ("high", high[axis])):
            spans = [np.array([value]) if i == axis else np.linspace(low[i], high[i], FACE_POINTS) for i in range(3)]
            points = np.stack(np.meshgrid(*spans, indexing="ij"), -1).reshape(-1, 3)
            yield f"{side} {'xyz'[axis]}", [tuple(point) for point in points.tolist()]


def draw_starts(scene: Scene, demands: ReachDemands, count: int, seed: int = 0) -> dict[str, float]:
    """Shares of `count` drawn starts: refused by cause; at the reach limit, among the accepted."""
    rng = np.random.default_rng(seed)
    refused = dict.fromkeys(("out of reach or not at rest", "in contact", "in another stage"), 0)
    short = bent = 0
    for _ in range(count):
        try:
            scene.reset(demands.draw_start(rng, scene.spec.workspace, scene.spec.max_opening))
        except UnreachableLayoutError:
            refused["out of reach or not at rest"] += 1
            continue
        facts = scene.facts()
        if facts.collision_arm or facts.collision_self or facts.collision_base:
            refused["in contact"] += 1
        elif not demands.is_start(facts):
            refused["in another stage"] += 1
        else:
            forward, up = _push(scene)
            short += forward < SHORT
            bent += abs(up) > BENT
    accepted = count - sum(refused.values())
    shares = {name: value / count for name, value in refused.items()} | {"accepted": accepted / count}
    tried = max(accepted, 1)
    return shares | {"at the reach limit": short / tried, "armx changes height": bent / tried}


def _push(scene: Scene) -> tuple[float, float]:
    """How far forward and up the hand goes under `PUSHES` full steps of armx, as shares of the commanded way."""
    action = np.zeros(len(scene.spec.actions))
    action[scene.spec.actions.index("armx")] = 1.0
    before = scene.facts()
    for _ in range(PUSHES):
        scene.step(action)
    way = PUSHES * scene.spec.action_speed[scene.spec.actions.index("armx")] * scene.spec.control_dt
    moved = (scene.facts().eef_position - before.eef_position) / way
    yaw = before.base_pose[2]
    return float(np.cos(yaw) * moved[0] + np.sin(yaw) * moved[1]), float(moved[2])


def scan(arm: Arm, scene: Scene, demands: ReachDemands, count: int = 2000) -> Iterator[str]:
    """The lines of the scan: maps of reach around the workspace of `scene`, and what became of `count` drawn starts."""
    w: Workspace = scene.spec.workspace
    xs = np.arange(w.hand_low[0] - AROUND, w.hand_high[0] + AROUND, 0.05)
    yield f"tilted hand: share of reachable postures; rows z, columns x from {xs[0]:.2f} by 0.05"
    for y in (0.0, w.hand_high[1]):
        yield f"y = {y}"
        for z in np.arange(w.hand_high[2] + AROUND, w.hand_low[2] - AROUND, -0.05):
            yield f"{z:.2f} " + " ".join(f"{arm.reachable((x, y, z), demands.tilts):4.2f}" for x in xs)
    ys = np.arange(w.object_low[1] - AROUND, w.object_high[1] + AROUND + 0.01, 0.05)
    yield f"box: X where all demanded poses are reachable; rows x, columns y from {ys[0]:.2f} by 0.05"
    for x in np.arange(w.object_low[0] - AROUND, w.object_high[0] + AROUND, 0.02):
        yield f"{x:.2f} " + "".join(".X"[arm.serves(x, y, w.table_height, demands)] for y in ys)
    yield "declared hand box: reachable share of each face"
    for name, points in faces(w.hand_low, w.hand_high):
        yield f"{name:7} {np.mean([arm.reachable(point, demands.tilts) for point in points]):.2f}"
    yield f"{count} drawn starts"
    for name, share in draw_starts(scene, demands, count).items():
        yield f"{name:28} {share:.3f}"
