"""The closed form of the LiDAR against distances worked out by hand and against a marching ray."""

from __future__ import annotations

import math

import numpy as np
import pytest

from causalbench.core.numerics import rotations
from causalbench.core.tasks import rooms
from causalbench.core.world import lidar
from causalbench.core.world.layout import box_rows

STILL = [1.0, 0.0, 0.0, 0.0]


def test_rays_go_from_right_to_left_over_220_degrees():
    wall_on_the_left = np.array([[5.0, 0.1, 1.0, 0.0, 2.1, 1.0, *STILL]])
    ranges = lidar.scan(wall_on_the_left, np.array([0.0, 0.0, 0.3, 0.0]))
    assert ranges.shape == (220,)
    assert ranges[0] == lidar.MAX_RANGE  # 110 degrees to the right
    np.testing.assert_allclose(ranges[-1], 2.0 / math.sin(math.radians(110)))
    ray = 200
    np.testing.assert_allclose(ranges[ray], 2.0 / math.sin(lidar.ANGLES[ray]))


def test_a_scan_follows_height_place_and_heading():
    post = np.array([[0.1, 0.1, 0.2, 1.0, 2.0, 0.2, *STILL]])
    facing = lidar.scan(post, np.array([1.0, 0.0, 0.3, math.pi / 2]))
    np.testing.assert_allclose(facing[109:111], 1.9, rtol=1e-4)
    assert (lidar.scan(post, np.array([1.0, 0.0, 0.41, math.pi / 2])) == lidar.MAX_RANGE).all()  # above it
    assert (lidar.scan(post, np.array([1.0, 0.0, 0.3, -math.pi / 2])) == lidar.MAX_RANGE).all()  # behind
    assert (lidar.scan(post, np.array([1.0, -20.0, 0.3, math.pi / 2])) == lidar.MAX_RANGE).all()  # too far


def test_tilted_boxes_and_batches():
    """Against a ray that marches in steps of half a millimetre and asks whether it is inside."""
    rng = np.random.default_rng(0)
    quaternions = rotations.canonical(rng.normal(size=(3, 4)))
    boxes = np.column_stack([rng.uniform(0.2, 0.5, (3, 3)), rng.uniform(-2, 2, (3, 2)), np.full(3, 0.3), quaternions])
    poses = np.array([[0.0, -4.0, 0.3, 1.5], [3.0, 3.0, 0.4, -2.0]])
    found = lidar.scan(np.stack([boxes, boxes]), poses)
    assert found.shape == (2, 220)
    along = np.arange(0.0, 10.0, 5e-4)
    for pose, ranges in zip(poses, found, strict=True):
        for ray in range(0, 220, 7):
            angle = pose[3] + lidar.ANGLES[ray]
            points = pose[:3] + along[:, None] * np.array([math.cos(angle), math.sin(angle), 0.0])
            inside = np.zeros(len(along), dtype=bool)
            for box in boxes:
                back = np.tile(rotations.conjugate(box[6:]), (len(points), 1))
                inside |= (np.abs(rotations.rotate(back, points - box[3:6])) <= box[:3]).all(-1)
            expected = along[inside.argmax()] if inside.any() else lidar.MAX_RANGE
            assert ranges[ray] == pytest.approx(expected, abs=6e-4)


@pytest.mark.parametrize("plan", range(rooms.N_PLANS))
def test_rooms_are_closed_and_furniture_stands_inside(plan):
    boxes = rooms.fixtures(plan)
    assert len(boxes) == len(rooms.fixtures(0))
    ranges = lidar.scan(box_rows(boxes), np.array([0.0, -2.0, 2.0, 0.0]))  # above the furniture
    assert (ranges < 6.3).all()
    for box in boxes:
        assert box.position[2] == box.half_extents[2]  # stands on the floor
    for box in boxes[4:]:
        assert (np.abs(box.position[:2]) < rooms.ROOM_HALF_EXTENTS).all()
        assert 2 * box.half_extents[2] > 0.4  # seen by the scanner
