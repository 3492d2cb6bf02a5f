"""A reset gives what the layout says, whatever the scene did before."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from causalbench.core import rotations
from causalbench.core.env import StageTaskEnv
from causalbench.core.layout import Box, Layout
from causalbench.core.scene import Scene
from causalbench.core.tasks import pure_manipulation as task
from causalbench.errors import UnreachableLayoutError
from causalbench_pybullet import make

UP = np.array([0.0, 0.0, 1.0])


def layouts(scene: Scene, seed: int, count: int) -> list[Layout]:
    rng = np.random.default_rng(seed)
    return [
        task.draw_layout(rng, scene.spec.workspace, scene.spec.max_opening, 1 + i % task.N_STAGES) for i in range(count)
    ]


def moved_base(layout: Layout, x: float, y: float, yaw: float) -> Layout:
    """The same start seen from the base, the base being at (x, y, yaw) instead of (0, 0, pi / 2)."""
    turn = rotations.from_axis_angle(2, yaw - math.pi / 2)

    def place(position: NDArray[np.float64]) -> NDArray[np.float64]:
        return rotations.rotate(turn, position) + np.array([x, y, 0.0])

    def box(old: Box) -> Box:
        return dataclasses.replace(
            old, position=place(old.position), quaternion=rotations.multiply(turn, old.quaternion)
        )

    return dataclasses.replace(
        layout,
        fixtures=tuple(box(fixture) for fixture in layout.fixtures),
        target=box(layout.target),
        base_pose=np.array([x, y, yaw]),
        eef_position=place(layout.eef_position),
        eef_quaternion=rotations.multiply(turn, layout.eef_quaternion),
    )


def walk(scene: Scene, seed: int, steps: int = 15) -> NDArray[np.float64]:
    """Hand and object poses (steps, 14) under random actions."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(steps):
        scene.step(rng.uniform(-1, 1, 7))
        f = scene.facts()
        rows.append(np.concatenate([f.eef_position, f.eef_quaternion, f.object_position, f.object_quaternion]))
    return np.array(rows)


def test_a_settled_start_obeys_the_layout(scene: Scene) -> None:
    accepted = 0
    for i, drawn in enumerate(layouts(scene, 0, 60)):
        layout = moved_base(drawn, 0.4, -0.3, 0.7) if i % 2 else drawn
        try:
            scene.reset(layout)
        except UnreachableLayoutError:
            continue
        accepted += 1
        for _ in range(2):
            facts = scene.facts()
            assert np.abs(facts.eef_position - layout.eef_position).max() < 1e-3
            assert rotations.angle_between(facts.eef_quaternion, layout.eef_quaternion) < math.radians(0.5)
            assert np.abs(facts.object_position - layout.target.position).max() < 1e-3
            assert rotations.angle_between(facts.object_quaternion, layout.target.quaternion) < math.radians(0.5)
            assert np.abs(facts.base_pose - layout.base_pose).max() < 1e-3
            assert facts.gripper_opening == pytest.approx(layout.gripper_opening, abs=1e-3)
            assert facts.eef_quaternion[0] >= 0
            assert facts.object_quaternion[0] >= 0
            scene.step(np.zeros(7))
    assert accepted > 40


def test_a_pose_out_of_reach_is_refused(scene: Scene) -> None:
    layout = dataclasses.replace(layouts(scene, 1, 1)[0], eef_position=np.array([0.0, 1.6, 0.8]))
    with pytest.raises(UnreachableLayoutError):
        scene.reset(layout)


def test_a_start_inside_the_table_is_refused(scene: Scene) -> None:
    layout = layouts(scene, 1, 1)[0]
    sunk = dataclasses.replace(layout.target, position=layout.target.position - UP * 0.02)
    with pytest.raises(UnreachableLayoutError):
        scene.reset(dataclasses.replace(layout, target=sunk))


def test_a_start_depends_on_nothing_that_was_before() -> None:
    """No trace of an earlier layout is left: masses, sizes, fixtures or memory of contacts."""
    used, fresh = make(), make()
    layout = layouts(used, 2, 1)[0]
    big = Box("shelf", np.array([0.1, 0.1, 0.05]), np.array([0.35, 0.75, 0.65]), np.array([1.0, 0.0, 0.0, 0.0]))
    target = dataclasses.replace(layout.target, half_extents=np.array([0.02, 0.03, 0.025]))
    used.reset(dataclasses.replace(layout, fixtures=(*layout.fixtures, big), target=target, target_mass=1.5))
    walk(used, 0)
    small = dataclasses.replace(layout.fixtures[0], half_extents=layout.fixtures[0].half_extents * [0.9, 0.9, 1.0])
    used.reset(dataclasses.replace(layout, fixtures=(small,)))
    walk(used, 1)
    used.reset(layout)
    fresh.reset(layout)
    assert np.array_equal(walk(used, 3, 40), walk(fresh, 3, 40))


def test_a_box_lies_on_a_second_fixture(scene: Scene) -> None:
    layout = layouts(scene, 2, 1)[0]
    top = np.array([0.1, 0.1, 0.02])
    shelf = Box("shelf", top, layout.target.position + UP * (top[2] - 0.025), np.array([1.0, 0.0, 0.0, 0.0]))
    raised = dataclasses.replace(layout.target, position=layout.target.position + UP * 2 * top[2])
    scene.reset(dataclasses.replace(layout, fixtures=(*layout.fixtures, shelf), target=raised))
    for _ in range(20):
        scene.step(np.zeros(7))
    assert np.abs(scene.facts().object_position - raised.position).max() < 1e-3


def test_two_scenes_do_not_touch_each_other(scene: Scene) -> None:
    other = make()
    first, second = layouts(scene, 4, 2)[0], layouts(scene, 5, 1)[0]
    scene.reset(first)
    alone = walk(scene, 6)
    scene.reset(first)
    rng, rows = np.random.default_rng(6), []
    other.reset(second)
    for _ in range(len(alone)):
        scene.step(rng.uniform(-1, 1, 7))
        other.step(np.ones(7))
        rows.append(scene.facts().eef_position)
    assert np.array_equal(np.array(rows), alone[:, :3])


def test_pressing_on_the_table_is_a_collision_of_the_arm(scene: Scene) -> None:
    StageTaskEnv(task.TASK, scene).reset(seed=0)
    down = np.zeros(7)
    down[2] = -1.0
    touched = False
    for _ in range(25):
        scene.step(down)
        touched = touched or bool(scene.facts().collision_arm)
    assert touched
    low = scene.facts().eef_position[2]
    for _ in range(5):
        scene.step(-down)
    assert scene.facts().eef_position[2] > low + 0.05  # pressing has wound nothing up
