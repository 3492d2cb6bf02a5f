"""Pure manipulation as pure functions: every expected number here was worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from causalbench.core.numerics.rotations import angle_between, rotate
from causalbench.core.staged.scene_worlds import judge
from causalbench.core.tasks import pure_manipulation as task
from causalbench.core.world.batch import select, stack
from causalbench.core.world.layout import Workspace

STILL = np.zeros(7)
FAR, HOVER, LOW, AT_BOX = (0.3, 0.2, 0.4), (0.0, 0.0, 0.15), (0.0, 0.0, 0.10), (0.0, 0.0, 0.012)
TILTED, UPRIGHT = 0.5, 0.05
YES = np.bool_(True)


def grip(value: float):
    return np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, value])


def terms(previous, action, now) -> dict[str, float]:
    """The reward terms that are not 0."""
    vector = judge(task.TASK, task.stage(previous), previous, action, now).rewards
    assert vector.shape == (9,)
    return {name: value for name, value in zip(task.TASK.term_names, vector, strict=True) if abs(value) > 1e-12}


# --- stage


@pytest.mark.parametrize(
    ("offset", "tilt", "expected"),
    [
        (FAR, TILTED, 1),
        (FAR, 0.0, 1),
        (HOVER, TILTED, 2),
        (HOVER, UPRIGHT, 3),
        (LOW, UPRIGHT, 3),
        (AT_BOX, UPRIGHT, 4),
        # Fallen back: too low for a tilted hand, too high or beside the box for any.
        (LOW, TILTED, 1),
        (AT_BOX, TILTED, 1),
        ((0.0, 0.0, 0.18), UPRIGHT, 1),
        ((0.03, 0.0, 0.012), UPRIGHT, 1),
        # Either side of each tolerance: 20 mm in x and y, 20 mm about the hover height, 12 mm about
        # 12 mm above the box centre, 0.1 rad.
        ((0.0199, -0.0199, 0.15), TILTED, 2),
        ((0.0201, 0.0, 0.15), TILTED, 1),
        ((-0.0201, 0.0, 0.15), TILTED, 1),
        ((0.0, 0.0201, 0.15), TILTED, 1),
        ((0.0, -0.0201, 0.15), TILTED, 1),
        ((0.0, 0.0, 0.1301), TILTED, 2),
        ((0.0, 0.0, 0.1299), TILTED, 1),
        ((0.0, 0.0, 0.1699), TILTED, 2),
        ((0.0, 0.0, 0.1701), TILTED, 1),
        ((0.0, 0.0, 0.1699), UPRIGHT, 3),
        ((0.0, 0.0, 0.1701), UPRIGHT, 1),
        ((0.0, 0.0, 0.0241), UPRIGHT, 3),
        ((0.0, 0.0, 0.0239), UPRIGHT, 4),
        ((0.0, 0.0, 0.0001), UPRIGHT, 4),
        ((0.0, 0.0, -0.0001), UPRIGHT, 1),
        (HOVER, 0.1001, 2),
        (HOVER, 0.0999, 3),
        (HOVER, -0.0999, 3),
        (AT_BOX, 0.0999, 4),
        (AT_BOX, 0.1001, 1),
    ],
)
def test_stage(pose, offset, tilt, expected):
    u = task.stage(pose(offset, tilt))
    assert u == expected
    assert u.shape == ()
    assert u.dtype == np.int64


def test_stage_does_not_depend_on_the_way_there(pose):
    way = [(FAR, TILTED), (HOVER, TILTED), (HOVER, UPRIGHT), (AT_BOX, UPRIGHT)]
    there = [int(task.stage(pose(*step))) for step in way]
    back = [int(task.stage(pose(*step))) for step in reversed(way)]
    assert there == [1, 2, 3, 4]
    assert back == [4, 3, 2, 1]


@pytest.mark.parametrize("angle", [0.0, 1e-4, 0.3, 1.5, 3.0, math.pi])
def test_tilt_is_the_angle_from_straight_down(pose, angle):
    # arccos resolves 1e-8 near 0.
    np.testing.assert_allclose(task.tilt(pose(FAR, angle)), angle, atol=3e-8)


def test_tilt_does_not_depend_on_the_sign_of_the_quaternion(pose):
    facts = pose(FAR, 0.4)
    assert task.tilt(facts) == task.tilt(pose(FAR, eef_quaternion=-facts.eef_quaternion))


# --- rewards


def test_stage_1_pays_ten_per_metre_on_each_axis(pose):
    got = terms(pose((0.10, -0.06, 0.30), TILTED), STILL, pose((0.08, -0.03, 0.26), TILTED))
    assert got == pytest.approx({"r_eefx": 0.2, "r_eefy": 0.3, "r_eefz1": 0.4})


def test_stage_1_charges_for_an_overshoot(pose):
    got = terms(pose((0.10, -0.06, 0.18), TILTED), STILL, pose((-0.12, 0.09, 0.10), TILTED))
    # z: 30 mm above the hover height before, 50 mm below it after.
    assert got == pytest.approx({"r_eefx": -0.2, "r_eefy": -0.3, "r_eefz1": -0.2})


def test_stage_1_pays_for_the_offset_and_not_for_the_place(pose):
    before = pose((0.10, 0.05, 0.30), TILTED)
    shift = np.array([0.04, 0.0, 0.0])
    both = pose((0.14, 0.05, 0.30), TILTED, object_position=before.object_position + shift)
    box = pose((0.10, 0.05, 0.30), TILTED, object_position=before.object_position + shift)
    assert terms(before, STILL, both) == {}
    assert terms(before, STILL, box) == pytest.approx({"r_eefx": 0.4})


def test_stage_2_pays_two_per_radian(pose):
    assert terms(pose(HOVER, 0.5), STILL, pose(HOVER, 0.3)) == pytest.approx({"r_ori": 0.4})
    assert terms(pose(HOVER, 0.3), STILL, pose(HOVER, 0.5)) == pytest.approx({"r_ori": -0.4})


def test_stage_3_pays_ten_per_metre_of_height(pose):
    assert terms(pose(LOW), STILL, pose((0.0, 0.0, 0.06))) == pytest.approx({"r_eefz2": 0.4})
    assert terms(pose(LOW), STILL, pose((0.0, 0.0, 0.13))) == pytest.approx({"r_eefz2": -0.3})


def test_stage_4_pays_for_the_grasp(pose):
    at_box = pose(AT_BOX, UPRIGHT)
    assert terms(at_box, grip(1.0), pose(AT_BOX, UPRIGHT, holding=YES)) == {"r_gripper": 5.0, "r_success": 2.0}
    assert terms(at_box, grip(1.0), at_box) == {}


@pytest.mark.parametrize("start", [(FAR, TILTED), (HOVER, TILTED), (LOW, UPRIGHT)])
@pytest.mark.parametrize(("command", "penalty"), [(1.0, -0.5), (1e-6, -0.5), (0.0, 0.0), (-1.0, 0.0)])
def test_closing_early_costs_half(pose, start, command, penalty):
    facts = pose(*start)
    assert terms(facts, grip(command), facts).get("r_gripper", 0.0) == penalty


@pytest.mark.parametrize("start", [(FAR, TILTED), (HOVER, TILTED), (LOW, UPRIGHT), (AT_BOX, UPRIGHT)])
def test_collisions_cost_half_each_in_every_stage(pose, start):
    now = pose(*start, collision_arm=YES, collision_self=YES)
    assert terms(pose(*start), STILL, now) == {"r_collision_arm": -0.5, "r_collision_self": -0.5}
    # What was in contact before the step does not count, nor does the base, which has no term here.
    assert terms(now, STILL, pose(*start, collision_base=YES)) == {}


@pytest.mark.parametrize(
    ("before", "after", "bonus"),
    [
        ((FAR, TILTED), (HOVER, TILTED), 2.0),
        ((HOVER, TILTED), (HOVER, UPRIGHT), 2.0),
        ((LOW, UPRIGHT), (AT_BOX, UPRIGHT), 2.0),
        ((FAR, UPRIGHT), (LOW, UPRIGHT), 2.0),  # 1 -> 3
        ((FAR, UPRIGHT), (AT_BOX, UPRIGHT), 2.0),  # 1 -> 4
        ((HOVER, TILTED), (AT_BOX, UPRIGHT), 2.0),  # 2 -> 4
        ((AT_BOX, UPRIGHT), (LOW, UPRIGHT), 0.0),
        ((LOW, UPRIGHT), (FAR, UPRIGHT), 0.0),
        ((FAR, TILTED), (FAR, TILTED), 0.0),
    ],
)
def test_a_step_forward_pays_one_bonus(pose, before, after, bonus):
    assert terms(pose(*before), STILL, pose(*after)).get("r_success", 0.0) == bonus


@pytest.mark.parametrize(
    ("start", "own"),
    [
        ((FAR, TILTED), {"r_eefx", "r_eefy", "r_eefz1"}),
        ((HOVER, TILTED), {"r_ori"}),
        ((LOW, UPRIGHT), {"r_eefz2"}),
        ((AT_BOX, UPRIGHT), set()),
    ],
)
def test_terms_of_other_stages_are_zero(pose, start, own):
    # Everything changes at once: place, tilt, contact.
    now = pose((0.05, -0.04, 0.22), 0.8, collision_arm=YES, collision_self=YES)
    collisions = {"r_collision_arm", "r_collision_self"}
    early = set() if start[0] == AT_BOX else {"r_gripper"}
    assert set(terms(pose(*start), grip(1.0), now)) == own | collisions | early


# --- success and reversal


def test_success_is_judged_on_the_pose_before_the_motion(pose):
    at_box, low = pose(AT_BOX, UPRIGHT), pose(LOW, UPRIGHT)
    held, lifted = pose(AT_BOX, UPRIGHT, holding=YES), pose(LOW, UPRIGHT, holding=YES)
    assert task.success(task.stage(at_box), held)
    assert task.success(task.stage(at_box), lifted)  # the motion of the same step is no cause
    assert not task.success(task.stage(low), held)
    assert not task.success(task.stage(at_box), at_box)
    assert not task.success(task.stage(held), at_box)
    assert terms(low, grip(1.0), held) == pytest.approx({"r_eefz2": 0.88, "r_gripper": -0.5, "r_success": 2.0})


def test_reversal(pose):
    def reversal(before, after):
        return bool(judge(task.TASK, task.stage(before), before, STILL, after).reversal)

    low, at_box = pose(LOW), pose(AT_BOX)
    assert reversal(at_box, low)
    assert reversal(low, pose(FAR))
    assert not reversal(low, at_box)
    assert not reversal(low, low)
    assert not reversal(at_box, pose(LOW, holding=YES))  # success is no reversal


# --- observe


def test_observe_gives_the_papers_variables_in_the_base_frame(pose):
    half = math.sqrt(0.5)
    facts = pose(
        AT_BOX,
        base_pose=np.array([1.0, 2.0, math.pi / 2]),
        object_position=np.array([0.9, 2.6, 0.725]),
        eef_position=np.array([1.2, 2.7, 0.9]),
        # Base turned by 90 degrees times straight down: (h, 0, 0, h) (0, 0, 1, 0) = (0, -h, h, 0).
        eef_quaternion=np.array([0.0, -half, half, 0.0]),
    )
    expected = [0.6, 0.1, 0.725, 0.7, -0.2, 0.9, 0.875, 0, 0, 1, 0, 0, 0, 1, 0]
    np.testing.assert_allclose(task.observe(facts), expected, atol=1e-15)
    assert task.STATE_NAMES[:7] == (
        *("pencil_box_x", "pencil_box_y", "pencil_box_z"),
        *("eefx", "eefy", "eefz", "target_eeflz"),
    )


@pytest.mark.parametrize("tilt", [-0.4, 0.4])
def test_observed_posture_does_not_jump_at_the_target(pose, tilt):
    facts = pose(AT_BOX, tilt)
    expected = [-math.sin(tilt / 2), 0.0, math.cos(tilt / 2), 0.0]
    np.testing.assert_allclose(task.observe(facts)[7:11], expected, atol=1e-15)
    flipped = pose(AT_BOX, eef_quaternion=-facts.eef_quaternion)
    np.testing.assert_array_equal(task.observe(flipped), task.observe(facts))


# --- batches


@pytest.fixture
def steps(pose):
    """(previous, actions, now), each with leading dimension 200, from all four stages."""
    rng = np.random.default_rng(0)
    spread = np.array([0.02, 0.02, 0.17])

    def draw():
        q = np.array([0.0, 0.0, 1.0, 0.0]) + rng.normal(0, 0.03, 4)
        return pose(
            rng.uniform(-1.1, 1.1, 3) * spread,
            eef_quaternion=q / np.linalg.norm(q),
            **{name: rng.random() < 0.5 for name in ("holding", "collision_arm", "collision_self")},
            base_pose=rng.uniform(-1, 1, 3),
        )

    previous, now = stack([draw() for _ in range(200)]), stack([draw() for _ in range(200)])
    assert set(task.stage(previous)) == {1, 2, 3, 4}
    return previous, rng.uniform(-1, 1, (200, 7)), now


def test_batched_equals_single(steps, make_scene):
    previous, actions, now = steps
    spec = make_scene().spec
    whole = {
        "stage": task.stage(now),
        "observe": task.observe(now),
        **judge(task.TASK, task.stage(previous), previous, actions, now)._asdict(),
        "expert": task.expert(now, spec),
    }
    for i in range(200):
        before, after = select(previous, i), select(now, i)
        single = {
            "stage": task.stage(after),
            "observe": task.observe(after),
            **judge(task.TASK, task.stage(before), before, actions[i], after)._asdict(),
            "expert": task.expert(after, spec),
        }
        for name, value in single.items():
            # numpy's vector loops may round the last bit of sin and arccos otherwise.
            np.testing.assert_allclose(whole[name][i], value, rtol=0, atol=1e-12, err_msg=name)
            assert np.shape(value) == whole[name].shape[1:], name


def test_functions_do_not_change_their_arguments(steps, make_scene):
    previous, actions, now = steps
    kept = [select(previous, np.arange(200)), actions.copy(), select(now, np.arange(200))]
    judge(task.TASK, task.stage(previous), previous, actions, now)
    task.observe(now)
    task.expert(now, make_scene().spec)
    for facts, copy in ((previous, kept[0]), (now, kept[2])):
        for name in facts.__slots__:
            np.testing.assert_array_equal(getattr(facts, name), getattr(copy, name))
    np.testing.assert_array_equal(actions, kept[1])


# --- layouts

NEAR = Workspace(0.7, (0.6, -0.1), (0.7, 0.1), (0.7, -0.2, 1.0), (0.8, 0.2, 1.1))
FAR_OFF = Workspace(0.4, (0.8, -0.3), (1.2, 0.5), (0.5, 0.0, 0.9), (1.5, 0.4, 1.5))


def in_base_frame(point):
    """World to base, the base at the origin turned by 90 degrees: world (x, y) is base (y, -x)."""
    return np.array([point[1], -point[0], point[2]])


@pytest.mark.parametrize("seed", range(5))
def test_one_seed_gives_the_same_unit_draws_in_two_workspaces(seed):
    units = []
    for workspace in (NEAR, FAR_OFF):
        layout = task.draw_layout(np.random.default_rng(seed), workspace, 0.1, 1)
        box, hand = in_base_frame(layout.target.position), in_base_frame(layout.eef_position)
        low, high = np.array(workspace.object_low), np.array(workspace.object_high)
        hand_low, hand_high = np.array(workspace.hand_low), np.array(workspace.hand_high)
        units.append([*((box[:2] - low) / (high - low)), *((hand - hand_low) / (hand_high - hand_low))])
        # The box, 5 cm high, stands on the table.
        assert box[2] == pytest.approx(workspace.table_height + 0.025)
    np.testing.assert_allclose(units[0], units[1], atol=1e-9)
    drawn = np.random.default_rng(seed).random(10)
    np.testing.assert_allclose(units[0], drawn[[0, 1, 3, 4, 5]], atol=1e-9)
    first, second = (task.draw_layout(np.random.default_rng(seed), w, 0.1, 1) for w in (NEAR, FAR_OFF))
    np.testing.assert_array_equal(first.eef_quaternion, second.eef_quaternion)
    np.testing.assert_array_equal(first.target.quaternion, second.target.quaternion)


def test_every_stage_takes_the_same_number_of_draws():
    states = []
    for stage in (1, 2, 3, 4):
        rng = np.random.default_rng(3)
        task.draw_layout(rng, NEAR, 0.1, stage)
        states.append(rng.bit_generator.state)
    assert all(state == states[0] for state in states)


@pytest.mark.parametrize("stage", [1, 2, 3, 4])
def test_layouts_are_upright_boxes_unit_quaternions_and_openings_within_range(stage):
    rng = np.random.default_rng(stage)
    for _ in range(50):
        layout = task.draw_layout(rng, NEAR, 0.1, stage)
        for q in (layout.eef_quaternion, layout.target.quaternion, *(box.quaternion for box in layout.fixtures)):
            assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-12)
            assert q[0] >= 0
        np.testing.assert_allclose(rotate(layout.target.quaternion, np.array([0.0, 0.0, 1.0])), [0, 0, 1], atol=1e-12)
        # Never narrower than the box, 3 cm.
        assert 0.03 < layout.gripper_opening <= 0.1
        (table,) = layout.fixtures
        assert table.position[2] + table.half_extents[2] == pytest.approx(0.7)
        # The hand starts 29 to 49 degrees off straight down in stage 1, at most the tolerance off in stages 3 and 4.
        facing = rotate(layout.eef_quaternion, np.array([0.0, 0.0, 1.0]))
        tilt = math.acos(-facing[2])
        assert (0.5 <= tilt <= 0.91) if stage == 1 else tilt <= (0.91 if stage == 2 else 0.1)


def test_a_start_of_stage_1_points_forward_of_straight_down():
    layout = task.draw_layout(np.random.default_rng(0), NEAR, 0.1, 1)
    facing = in_base_frame(rotate(layout.eef_quaternion, np.array([0.0, 0.0, 1.0])))
    assert facing[0] > 0.4
    assert facing[2] < 0


def test_the_fingers_of_an_upright_start_close_across_the_short_side():
    layout = task.draw_layout(np.random.default_rng(0), NEAR, 0.1, 4)
    closing = rotate(layout.eef_quaternion, np.array([0.0, 1.0, 0.0]))
    short_side = rotate(layout.target.quaternion, np.array([0.0, 1.0, 0.0]))
    # At most the box's yaw of 0.1 rad and the hand's tilt of 0.1 rad apart.
    assert abs(closing @ short_side) > math.cos(0.2)
    assert angle_between(layout.eef_quaternion, layout.eef_quaternion) == pytest.approx(0.0, abs=1e-7)
