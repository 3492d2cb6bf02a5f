"""What each macro action does, in the units that the spec declares."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from causalbench.core import rotations
from causalbench.core.layout import Layout
from causalbench.core.scene import Facts, Scene
from causalbench.core.tasks import pure_manipulation as task
from causalbench_pybullet import make


def start(scene: Scene, x: float, z: float, pitch: float = 0.0) -> Facts:
    """Reset to a hand `pitch` rad forward of face down at (x, 0, z) in the base frame, the box out of the way."""
    layout = task.draw_layout(np.random.default_rng(0), scene.spec.workspace, scene.spec.max_opening, 1)
    posture = rotations.multiply(task.FACE_DOWN, rotations.from_axis_angle(1, -pitch))
    away = dataclasses.replace(layout.target, position=np.array([0.4, 0.7, scene.spec.workspace.table_height + 0.025]))
    scene.reset(
        dataclasses.replace(
            layout,
            target=away,
            eef_position=rotations.rotate(task.BASE_QUATERNION, np.array([x, 0.0, z])),
            eef_quaternion=rotations.canonical(rotations.multiply(task.BASE_QUATERNION, posture)),
        )
    )
    return scene.facts()


def play(scene: Scene, name: str, value: float, steps: int) -> Facts:
    action = np.zeros(len(scene.spec.actions))
    action[scene.spec.actions.index(name)] = value
    for _ in range(steps):
        scene.step(action)
    return scene.facts()


def moved(before: Facts, after: Facts) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Translation along the base axes (3,) and rotation vector about the hand's own first axes (3,)."""
    shift = rotations.rotate(rotations.conjugate(task.BASE_QUATERNION), after.eef_position - before.eef_position)
    turn = rotations.multiply(rotations.conjugate(before.eef_quaternion), after.eef_quaternion)
    return shift, rotations.rotation_vector(turn)


@pytest.mark.parametrize(
    ("name", "value", "x", "z", "pitch"),
    [
        ("armx", 1.0, 0.58, 0.80, 0.2),
        ("armx", -1.0, 0.80, 0.80, 0.2),
        ("army", 1.0, 0.70, 0.80, 0.2),
        ("army", -1.0, 0.70, 0.80, 0.2),
        ("armz", 1.0, 0.70, 0.75, 0.2),
        ("armz", -1.0, 0.70, 0.95, 0.2),
        ("armrx", 1.0, 0.70, 0.85, 0.3),
        ("armrx", -1.0, 0.70, 0.85, 0.3),
        ("armry", 1.0, 0.70, 0.85, 0.8),
        ("armry", -1.0, 0.70, 0.85, 0.0),
        ("armrz", 1.0, 0.70, 0.85, 0.2),
        ("armrz", -1.0, 0.70, 0.85, 0.2),
    ],
)
def test_ten_full_steps_of_an_arm_action(
    scene: Scene, name: str, value: float, x: float, z: float, pitch: float
) -> None:
    before = start(scene, x, z, pitch)
    shift, turn = moved(before, play(scene, name, value, 10))
    index = scene.spec.actions.index(name)
    expected = np.zeros(6)
    expected[index] = value * scene.spec.action_speed[index] * 10 * scene.spec.control_dt
    size = abs(expected[index])
    error = np.append(shift, turn) - expected
    assert abs(error[index]) < 0.10 * size
    # Metres and radians alike: 5% of what was asked for in the other directions.
    assert np.abs(np.delete(error, index)).max() < 0.05 * size


def test_half_an_action_goes_half_as_far(scene: Scene) -> None:
    before = start(scene, 0.65, 0.8, 0.2)
    shift, _ = moved(before, play(scene, "armx", 0.5, 10))
    assert shift[0] == pytest.approx(0.1, rel=0.1)


def test_the_gripper_closes_and_opens_at_its_speed(scene: Scene) -> None:
    before = start(scene, 0.70, 0.85)
    assert before.gripper_opening == pytest.approx(scene.spec.max_opening, abs=1e-3)
    closed = play(scene, "grip", 1.0, 4)
    assert before.gripper_opening - closed.gripper_opening == pytest.approx(0.08, rel=0.1)
    play(scene, "grip", 1.0, 10)
    assert scene.facts().gripper_opening < 0.003
    opened = play(scene, "grip", -1.0, 10)
    assert opened.gripper_opening > 0.98 * scene.spec.max_opening


def test_zero_holds_the_pose(scene: Scene) -> None:
    before = start(scene, 0.70, 0.85, 0.5)
    after = play(scene, "grip", 0.0, 20)
    shift, turn = moved(before, after)
    assert np.abs(shift).max() < 1e-3
    assert np.abs(turn).max() < math.radians(0.5)
    assert after.gripper_opening == pytest.approx(before.gripper_opening, abs=1e-3)
    assert np.allclose(after.base_pose, before.base_pose, atol=1e-3)


def test_zero_keeps_the_grip_and_one_second_of_opening_opens(grasped: Scene) -> None:
    before = grasped.facts()
    held = play(grasped, "grip", 0.0, 30)
    assert held.holding
    assert held.gripper_opening == pytest.approx(before.gripper_opening, abs=5e-4)
    play(grasped, "grip", 1.0, 30)  # three seconds of squeezing wind nothing up
    opened = play(grasped, "grip", -1.0, 10)
    assert not opened.holding
    assert opened.gripper_opening > 0.98 * grasped.spec.max_opening


def test_a_released_box_falls_with_g() -> None:
    scene = make(control_hz=60.0)
    begin = start(scene, 0.70, 0.85)
    scene.reset(_box_under(scene, begin))
    play(scene, "grip", 1.0, 48)
    assert scene.facts().holding
    play(scene, "armz", 1.0, 90)
    assert scene.facts().holding
    heights = [float(play(scene, "grip", -1.0, 1).object_position[2]) for _ in range(17)]
    falls = np.diff(heights, 2)[-4:]
    assert np.allclose(falls, -9.81 * scene.spec.control_dt**2, rtol=0.03), falls


def _box_under(scene: Scene, facts: Facts) -> Layout:
    """A start with the hand around the box, ready to close."""
    workspace = scene.spec.workspace
    layout = task.draw_layout(np.random.default_rng(0), workspace, scene.spec.max_opening, 4)
    box = np.append(facts.eef_position[:2], workspace.table_height + task.BOX_HALF_EXTENTS[2])
    return dataclasses.replace(
        layout,
        target=dataclasses.replace(layout.target, position=box, quaternion=task.BASE_QUATERNION),
        eef_position=box,
        eef_quaternion=facts.eef_quaternion,
        gripper_opening=0.06,
    )
