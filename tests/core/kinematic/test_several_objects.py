"""The kinematic backend with boxes beside the target, standing and driving, alone and in a batch."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from causalbench.conformance.moves import act, grasp, row, start, walk
from causalbench.core.kinematic import make
from causalbench.core.numerics import rotations
from causalbench.core.world.batch import select
from causalbench.core.world.layout import Box
from causalbench.processes import call_in_new_interpreter

STANDING_AND_DRIVING = pytest.mark.parametrize("mobile", [False, True])


def beside(layout, *shifts, half=(0.02, 0.01, 0.03)):
    """`layout` with boxes `shifts` m away from the target, 2 cm wide between the fingers."""
    turns = [rotations.from_axis_angle(2, 0.1 * i) for i in range(len(shifts))]
    others = tuple(
        Box(
            f"box {i}",
            np.array(half),
            layout.target.position + shift,
            rotations.multiply(turn, layout.target.quaternion),
        )
        for i, (shift, turn) in enumerate(zip(shifts, turns, strict=True))
    )
    return dataclasses.replace(layout, others=others, other_masses=(0.2,) * len(others))


def swapped(layout):
    """`layout` in which the hand is around the first other box, and the target is where that one was."""
    other, target = layout.others[0], layout.target
    return dataclasses.replace(
        layout,
        target=dataclasses.replace(target, position=other.position, quaternion=other.quaternion),
        others=(dataclasses.replace(other, position=target.position, quaternion=target.quaternion), *layout.others[1:]),
    )


@pytest.fixture
def around(request):
    """A function (mobile) that gives a scene and a layout with the hand around the target, two boxes elsewhere."""

    def around(mobile):
        scene = make(mobile)
        layout = start(scene, 0, 4)
        return scene, beside(layout, np.array([0.2, 0.1, 0.0]), np.array([-0.2, 0.0, 0.0]))

    return around


@STANDING_AND_DRIVING
def test_others_are_where_the_layout_puts_them_and_rest_there(around, mobile):
    scene, layout = around(mobile)
    scene.reset(layout)
    first = scene.facts()
    walk(scene, 1, 30)
    for facts in (first, scene.facts()):
        assert facts.other_positions.shape == (2, 3)
        assert np.allclose(facts.other_positions, [box.position for box in layout.others], atol=1e-12)
        for found, box in zip(facts.other_quaternions, layout.others, strict=True):
            assert rotations.angle_between(found, box.quaternion) < 1e-7


@STANDING_AND_DRIVING
def test_others_change_nothing_of_the_rest(around, mobile):
    """The same numbers, to the bit, as in a world without them, also while the target is carried."""
    scene, layout = around(mobile)
    alone = make(mobile)
    alone.reset(dataclasses.replace(layout, others=(), other_masses=()))
    scene.reset(layout)
    rng = np.random.default_rng(0)
    for step in range(60):
        action = rng.uniform(-0.4, 0.4, len(scene.spec.actions))
        action[-1] = 1.0 if step < 12 else 0.0
        scene.step(action)
        alone.step(action)
        with_others, without = scene.facts(), alone.facts()
        assert with_others.other_positions.shape == (2, 3)
        assert np.array_equal(row(first_of(with_others, 0)), row(without))
    assert without.holding


@STANDING_AND_DRIVING
def test_the_hand_holds_another_box_as_it_holds_the_target(around, mobile):
    """The same motion, box for box: what the target does in one world the other box does in the other."""
    scene, layout = around(mobile)
    target, other = (dataclasses.replace(box, half_extents=layout.target.half_extents) for box in
                     (layout.target, layout.others[0]))  # fmt: skip
    layout = dataclasses.replace(layout, target=target, others=(other,), other_masses=(0.2,))
    scene.reset(layout)
    second = make(mobile)
    second.reset(swapped(layout))
    rng = np.random.default_rng(1)
    for step in range(60):
        action = rng.uniform(-0.4, 0.4, len(scene.spec.actions))
        action[-1] = 1.0 if step < 12 else 0.0
        scene.step(action)
        second.step(action)
        a, b = scene.facts(), second.facts()
        assert np.array_equal(a.object_position, b.other_positions[0])
        assert np.array_equal(a.object_quaternion, b.other_quaternions[0])
        assert np.array_equal(b.object_position, a.other_positions[0])
        assert np.array_equal(a.gripper_opening, b.gripper_opening)
        assert not b.holding
    assert a.holding
    assert np.linalg.norm(a.object_position - layout.target.position) > 0.05


@STANDING_AND_DRIVING
def test_a_snapshot_keeps_others_in_any_scene_batch_and_process(around, mobile):
    scene, layout = around(mobile)
    scene.reset(swapped(layout))
    act(scene, 12, grip=1.0)
    act(scene, 5, armz=1.0)
    snapshot = scene.snapshot()
    expected = _continued(snapshot, mobile)
    assert np.array_equal(_replayed(scene), expected)
    scene.restore(snapshot)  # into a scene that already has others
    assert np.array_equal(_replayed(scene), expected)
    assert np.array_equal(call_in_new_interpreter(_continued, snapshot, mobile, timeout=120.0), expected)
    batch = scene.batch(2)
    batch.restore(0, make_snapshot(mobile))
    batch.restore(1, snapshot)
    assert np.array_equal(row(select(batch.facts(), 1)), expected[0])
    assert batch.snapshot(1) == snapshot


def make_snapshot(mobile):
    """Of a world without others."""
    scene = make(mobile)
    start(scene, 3)
    return scene.snapshot()


def _replayed(scene):
    return np.vstack([row(scene.facts()), walk(scene, 2)])


def _continued(snapshot, mobile):
    scene = make(mobile)
    scene.restore(snapshot)
    return _replayed(scene)


@STANDING_AND_DRIVING
def test_worlds_of_a_batch_may_have_different_numbers_of_boxes(around, mobile):
    scene, layout = around(mobile)
    layouts = [
        dataclasses.replace(layout, others=(), other_masses=()),
        swapped(layout),
        beside(layout, np.full(3, 0.3)),
    ]
    batch, scenes = scene.batch(3), [make(mobile) for _ in range(3)]
    for index in (1, 0, 2):
        batch.reset(index, layouts[index])
        scenes[index].reset(layouts[index])
    rng = np.random.default_rng(4)
    for step in range(40):
        actions = rng.uniform(-0.4, 0.4, (3, len(scene.spec.actions)))
        actions[:, -1] = 1.0 if step < 12 else 0.0
        batch.step(actions)
        facts = batch.facts()
        assert facts.other_positions.shape == (3, 2, 3)
        for index, one in enumerate(scenes):
            one.step(actions[index])
            own, found = one.facts(), select(facts, index)
            number = len(layouts[index].others)
            assert np.isnan(found.other_positions[number:]).all()
            assert np.array_equal(row(own), row(first_of(found, number)))


def first_of(facts, number):
    """`facts` with only so many of the other objects."""
    positions, quaternions = facts.other_positions[:number], facts.other_quaternions[:number]
    return dataclasses.replace(facts, other_positions=positions, other_quaternions=quaternions)


def test_a_picture_shows_them(around):
    scene, layout = around(False)
    scene.reset(layout)
    shown = scene.render(64, 48)
    scene.reset(dataclasses.replace(layout, others=(), other_masses=()))
    assert not np.array_equal(shown, scene.render(64, 48))
    batch = scene.batch(2)
    batch.reset(0, layout)
    batch.reset(1, dataclasses.replace(layout, others=(), other_masses=()))
    assert np.array_equal(batch.render(64, 48), np.stack([shown, scene.render(64, 48)]))


def test_the_target_is_grasped_as_ever(around):
    scene, _ = around(False)
    grasp(scene)
    assert scene.facts().holding
