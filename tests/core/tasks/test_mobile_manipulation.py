"""Mobile manipulation as pure functions: every expected number here was worked out by hand."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math

import numpy as np
import pytest

from causalbench.core.kinematic.mobile import MOBILE_SPEC
from causalbench.core.staged.scene_worlds import judge
from causalbench.core.tasks import mobile_manipulation as task
from causalbench.core.tasks import rooms
from causalbench.core.world.batch import select, stack
from causalbench.core.world.facts import Facts
from causalbench.errors import UserError
from causalbench.plugins.manager import installed
from causalbench.plugins.venues import worlds_maker
from causalbench.registration import make_env

STILL = np.zeros(5)
WORKSPACE, OPENING = MOBILE_SPEC.workspace, MOBILE_SPEC.max_opening
YES = np.bool_(True)


def place(rho=2.0, theta=0.0, hand=(0.6, 0.0, 0.7), yaw=0.0, **changes) -> Facts:
    """The base at (1, -1), heading `yaw`; the target `rho` away at `theta` from straight ahead; `hand` in its frame."""
    no = np.bool_(False)
    base = np.array([1.0, -1.0, yaw])
    cos, sin = math.cos(yaw), math.sin(yaw)
    world = [1.0 + cos * hand[0] - sin * hand[1], -1.0 + sin * hand[0] + cos * hand[1], hand[2]]
    target = [1.0 + rho * math.cos(yaw + theta), -1.0 + rho * math.sin(yaw + theta), 0.7]
    still = np.array([1.0, 0.0, 0.0, 0.0])
    fields = {
        "eef_position": np.array(world),
        "eef_quaternion": still,
        "gripper_opening": np.float64(0.1),
        "holding": no,
        "object_position": np.array(target),
        "object_quaternion": still,
        "base_pose": base,
        "base_velocity": np.array([0.3, -0.2]),
        "collision_base": no,
        "collision_arm": no,
        "collision_self": no,
    }
    return Facts(**fields | changes)


def terms(previous: Facts, now: Facts) -> dict[str, float]:
    """The reward terms that are not 0."""
    vector = judge(task.TASK, task.stage(previous), previous, STILL, now).rewards
    return {name: value for name, value in zip(task.TASK.term_names, vector, strict=True) if abs(value) > 1e-12}


@pytest.mark.parametrize(
    ("rho", "theta", "expected"),
    [
        (2.0, 0.0, 1),
        (0.801, 0.0, 1),
        (0.799, 1.0, 2),
        (0.799, -math.pi, 2),
        (0.799, 0.101, 2),
        (0.799, -0.101, 2),
        (0.799, 0.099, 3),
        (0.4, -0.099, 3),
    ],
)
@pytest.mark.parametrize("yaw", [0.0, 3.0, -3.1])
def test_stage(rho, theta, expected, yaw):
    u = task.stage(place(rho, theta, yaw=yaw))
    assert u == expected
    assert u.shape == ()
    assert u.dtype == np.int64


def test_the_state_is_that_of_the_appendix():
    state = task.observe(place(1.5, 0.4, (0.6, 0.1, 0.75), yaw=2.9))
    np.testing.assert_allclose(state, [1.5, 0.4, 0.7, 0.3, -0.2, 0.6, 0.1, 0.75], atol=1e-12)
    assert len(task.STATE_NAMES) == len(state)


def test_stage_1_pays_ten_per_metre_of_the_base_alone():
    assert terms(place(2.0), place(1.94, 0.3, (0.5, 0.1, 0.9))) == pytest.approx({"r_rho": 0.6})
    assert terms(place(2.0), place(2.06)) == pytest.approx({"r_rho": -0.6})


def test_stage_2_pays_two_per_radian_either_way():
    assert terms(place(0.7, 0.5), place(0.7, 0.4)) == pytest.approx({"r_theta": 0.2})
    assert terms(place(0.7, -0.5), place(0.7, -0.6)) == pytest.approx({"r_theta": -0.2})
    # Through straight behind: 3.1 to -3.1 is as far from the target as before.
    assert terms(place(0.7, 3.1), place(0.7, -3.1)) == {}


def test_stage_3_pays_along_the_axes_of_the_world():
    # Facing world y, the target is at (1, -0.3, 0.7) and the hand moves from (0.95, -0.5, 0.6) to (0.97, -0.45, 0.63).
    before = place(0.7, 0.0, (0.5, 0.05, 0.6), yaw=math.pi / 2)
    after = place(0.7, 0.0, (0.55, 0.03, 0.63), yaw=math.pi / 2)
    assert terms(before, after) == pytest.approx({"r_eefx": 0.2, "r_eefy": 0.5, "r_eefz": 0.3})


def test_success_is_the_hand_in_the_target_after_a_step_from_stage_3():
    near, there, off = place(0.7), place(0.7, hand=(0.66, 0.0, 0.72)), place(0.7, hand=(0.66, 0.03, 0.72))
    assert task.success(task.stage(near), there)  # 45 mm
    assert not task.success(task.stage(near), off)  # 54 mm
    assert not task.success(task.stage(place(0.7, 0.2)), there)
    assert terms(near, there)["r_success"] == 2.0


@pytest.mark.parametrize(
    ("before", "after", "bonus"),
    [
        ((2.0, 1.0), (0.7, 1.0), 2.0),
        ((2.0, 0.0), (0.7, 0.0), 2.0),
        ((0.7, 1.0), (0.7, 0.0), 2.0),
        ((0.7, 0.0), (2.0, 0.0), 0.0),
    ],
)
def test_a_step_forward_pays_one_bonus_and_one_back_none(before, after, bonus):
    assert terms(place(*before), place(*after)).get("r_success", 0.0) == bonus


@pytest.mark.parametrize("start", [(2.0, 0.0), (0.7, 1.0), (0.7, 0.0)])
def test_collisions_cost_half_each_in_every_stage(start):
    now = place(*start, collision_base=YES, collision_arm=YES, collision_self=YES)
    assert terms(place(*start), now) == {"r_collision_base": -0.5, "r_collision_arm": -0.5, "r_collision_self": -0.5}
    assert terms(now, place(*start)) == {}


def test_batches_are_judged_as_their_members():
    singles = [place(2.0), place(0.7, 1.0), place(0.7), place(0.7, hand=(0.69, 0.0, 0.7))]
    nexts = [place(1.9), place(0.7, 0.9), place(0.7, hand=(0.69, 0.0, 0.7)), place(2.0)]
    before, after = stack(singles), stack(nexts)
    whole = judge(task.TASK, task.stage(before), before, np.zeros((4, 5)), after)
    for i in range(4):
        one = judge(task.TASK, task.stage(singles[i]), singles[i], STILL, nexts[i])
        np.testing.assert_array_equal(whole.rewards[i], one.rewards)
        assert whole.success[i] == one.success
        np.testing.assert_array_equal(task.observe(before)[i], task.observe(select(before, i)))
        np.testing.assert_array_equal(task.expert(before, MOBILE_SPEC)[i], task.expert(singles[i], MOBILE_SPEC))


# --- layouts


@pytest.mark.parametrize("stage", [1, 2, 3])
def test_starts_stand_clear_and_can_be_driven(stage):
    """Independent of the grid that they were drawn from: distances to boxes, and a way for the whole footprint."""
    plans = set()
    for seed in range(40):
        layout = task.draw_layout(np.random.default_rng(seed), WORKSPACE, OPENING, stage)
        plans.add(layout.fixtures[4].position.tobytes())
        base, target = layout.base_pose[:2], layout.target.position
        footprint = WORKSPACE.carry.footprint
        for point in (base, target[:2]):
            assert min(_distance(box, point) for box in layout.fixtures) >= footprint
        lengths = rooms.ground(layout.fixtures, footprint).distances_from(target[:2])
        cell = rooms.ground(layout.fixtures, footprint).cell(base)
        assert np.hypot(*(base - target[:2])) - 0.2 <= lengths[cell] < 20.0
        assert 0.60 <= target[2] <= 0.85
        assert layout.target_mass == 0.0
    assert len(plans) == rooms.N_PLANS


def _distance(box, point):
    """From points on the outline of the box."""
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1], [1, 1]]) * box.half_extents[:2]
    outline = np.concatenate([np.linspace(a, b, 100) for a, b in itertools.pairwise(corners)])
    yaw = 2 * math.atan2(box.quaternion[3], box.quaternion[0])
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    return np.hypot(*(outline @ turn.T + box.position[:2] - point).T).min()


def test_draws_take_the_same_numbers_whatever_the_stage():
    states = []
    for stage in (1, 2, 3):
        rng = np.random.default_rng(5)
        task.draw_layout(rng, WORKSPACE, OPENING, stage)
        states.append(rng.random())
    assert states[0] == states[1] == states[2]


def test_a_robot_that_does_not_drive_is_refused():
    kinematic = installed().backend("kinematic")
    standing = dataclasses.replace(kinematic, variants=kinematic.variants[:1])
    with pytest.raises(UserError, match=r"cannot run task 'mobile_manipulation': .* lacks lidar, mobile_base"):
        worlds_maker(standing, task.TASK)


# --- in every backend that drives


@pytest.mark.long
def test_the_expert_arrives_without_collision(mobile_env):
    """Five of these starts are in S47, too."""
    for seed in range(50):
        mobile_env.reset(seed=seed)
        over = success = False
        while not over:
            action = mobile_env.worlds.expert()
            obs, _, success, truncated, _ = mobile_env.step(action)
            facts = mobile_env.worlds.facts
            collided = facts.collision_base or facts.collision_arm or facts.collision_self
            assert not collided, seed
            assert mobile_env.observation_space.contains(obs)
            over = success or truncated
        assert success, seed


@pytest.mark.parametrize("stage", [1, 2, 3])
def test_resets_into_a_stage(mobile_env, stage):
    for seed in range(5):
        obs, info = mobile_env.reset(seed=seed, options={"stage": stage})
        assert info["stage"] == stage
        assert set(obs) == {"state", "features", "stage", "lidar"}
        assert mobile_env.observation_space.contains(obs)


def test_the_same_seed_is_the_same_room_and_scan():
    """Where footprints are equal; 1 mm, but for rays past an edge: of 1100, at most 5."""
    scans, layouts = {}, {}
    for backend in ("kinematic", "gymrob", "pybullet", "robosuite"):
        env = make_env("mobile_manipulation", backend)
        scans[backend] = np.array([env.reset(seed=seed)[0]["lidar"] for seed in range(5)])
        draw = functools.partial(task.draw_layout, workspace=env.worlds.scene.spec.workspace, max_opening=0.1, stage=1)
        layouts[backend] = [draw(np.random.default_rng(seed)) for seed in range(5)]
        env.close()
    first = scans.pop("kinematic")
    assert (first < 10.0).all()  # walls all round
    for backend, scan in scans.items():
        assert (np.abs(scan - first) > 1e-3).sum() <= 5, backend
        for mine, other in zip(layouts[backend], layouts["kinematic"], strict=True):
            np.testing.assert_array_equal(mine.base_pose, other.base_pose)
            np.testing.assert_array_equal(mine.target.position, other.target.position)
