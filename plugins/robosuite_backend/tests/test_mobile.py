"""The PandaOmron's base: what robosuite's own controller gets wrong, and what the declared `carry` promises."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from itertools import product

import mujoco
import numpy as np
import pytest

from causalbench.backend import Layout, rotations
from causalbench.conformance.moves import act
from causalbench.core.tasks import mobile_manipulation as task
from causalbench.core.tasks import rooms
from causalbench_mujoco import contacts
from causalbench_robosuite import model as panda
from causalbench_robosuite.model import AXIS, FIXED_FOOT, FOOT
from causalbench_robosuite.scene import CARRY, RobosuiteScene, mobile_workspace
from causalbench_robosuite.world import PandaWorld


@pytest.fixture(scope="module")
def scene() -> Iterator[RobosuiteScene]:
    scene = RobosuiteScene(mobile=True)
    yield scene
    scene.close()


def carried(yaw: float, hand: tuple[float, float, float]) -> Layout:
    """The base in the middle of an empty room, heading `yaw`, the hand at `hand` in its frame."""
    layout = task.draw_layout(np.random.default_rng(0), dataclasses.replace(mobile_workspace(), carry=CARRY), 0.07, 1)
    turn = rotations.from_axis_angle(2, yaw)
    return dataclasses.replace(
        layout,
        fixtures=rooms.fixtures(0)[:4],
        base_pose=np.array([0.0, 0.0, yaw]),
        eef_position=rotations.rotate(turn, np.array(hand)),
        eef_quaternion=rotations.canonical(rotations.multiply(turn, rotations.FACE_DOWN)),
    )


@pytest.mark.parametrize("yaw", [0.0, 0.6, 1.06, 2.5, -0.8, -2.9])
@pytest.mark.parametrize("value", [1.0, 0.1, -0.2])
def test_forward_drives_along_the_heading_however_slowly(scene: RobosuiteScene, yaw: float, value: float) -> None:
    scene.reset(carried(yaw, (0.6, 0.0, 0.7)))
    before = scene.facts().base_pose
    x, y, turned = act(scene, 10, forward=value).base_pose - before
    way = value * 0.6
    assert np.hypot(x - way * math.cos(yaw), y - way * math.sin(yaw)) < 0.02 * abs(way)
    assert abs(turned) < 1e-3


@pytest.mark.parametrize("action", [{"forward": 1.0}, {"turn": 1.0}, {"forward": -1.0, "turn": -1.0}])
def test_the_hand_rides_along(scene: RobosuiteScene, action: dict[str, float]) -> None:
    """Relative to the base it swings by less than 15 mm when the base starts or stops, and comes back."""
    hand = (0.6, 0.0, 0.7)
    scene.reset(carried(0.4, hand))
    for count, moves, most in ((5, action, 0.015), (5, {}, 0.015), (10, {}, 0.001)):
        for _ in range(count):
            facts = act(scene, 1, **moves)
            back = rotations.from_axis_angle(2, -facts.base_pose[2])
            place = rotations.rotate(back, facts.eef_position - np.append(facts.base_pose[:2], 0.0))
            if most > 0.001:
                assert np.linalg.norm(place - hand) < most
    assert np.linalg.norm(place - hand) < most


def test_robot_and_carried_hand_stay_within_the_declared_footprint(scene: RobosuiteScene) -> None:
    low, high = CARRY.hand_low, CARRY.hand_high
    for hand in product(*zip(low, high, strict=True)):
        scene.reset(carried(0.0, hand))
        model, data, classes = scene.model, scene.data, panda.geom_classes(scene.model)
        for geom in np.flatnonzero((classes != contacts.FIXTURE) & (classes != contacts.TARGET)):
            corners = (
                np.array(list(product((-1.0, 1.0), repeat=3))) * model.geom_aabb[geom, 3:] + model.geom_aabb[geom, :3]
            )
            points = corners @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
            assert np.hypot(*points[:, :2].T).max() < CARRY.footprint, model.geom(geom).name


def test_the_arm_stands_where_the_workspace_takes_it_to_be(scene: RobosuiteScene) -> None:
    scene.reset(carried(0.0, (0.6, 0.0, 0.7)))
    np.testing.assert_allclose(scene.data.body("robot0_link0").xpos, [AXIS, 0.0, FOOT], atol=1e-6)
    fixed = PandaWorld(0.002, n_fixtures=1)
    fixed.base.place(np.zeros(3))
    mujoco.mj_kinematics(fixed.model, fixed.data)
    np.testing.assert_allclose(fixed.data.body("robot0_link0").xpos, [0.0, 0.0, FIXED_FOOT], atol=1e-3)
