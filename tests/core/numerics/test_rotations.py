"""Rotations against scipy, which writes quaternions (x, y, z, w)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from causalbench.core.numerics import rotations

N = 500
RNG = np.random.default_rng(7)
A, B = (Rotation.random(N, random_state=seed) for seed in (1, 2))
V = RNG.normal(size=(N, 3))


def ours(rotation: Rotation) -> np.ndarray:
    return np.roll(rotation.as_quat(), 1, axis=-1)


def same_rotation(q: np.ndarray, rotation: Rotation) -> None:
    np.testing.assert_allclose(np.abs((q * ours(rotation)).sum(-1)), 1.0, atol=1e-12)


def test_multiply():
    same_rotation(rotations.multiply(ours(A), ours(B)), A * B)


def test_multiply_broadcasts():
    one, many = ours(A)[0], ours(B)
    np.testing.assert_allclose(rotations.multiply(one, many), [rotations.multiply(one, q) for q in many], atol=1e-15)
    np.testing.assert_allclose(rotations.multiply(many, one), [rotations.multiply(q, one) for q in many], atol=1e-15)


def test_conjugate_is_the_inverse():
    same_rotation(rotations.conjugate(ours(A)), A.inv())


def test_rotate():
    np.testing.assert_allclose(rotations.rotate(ours(A), V), A.apply(V), atol=1e-12)


def test_rotate_broadcasts():
    one, up = ours(A)[0], np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(rotations.rotate(one, V), A[0].apply(V), atol=1e-12)
    np.testing.assert_allclose(rotations.rotate(ours(A), up), A.as_matrix()[:, :, 2], atol=1e-12)
    np.testing.assert_allclose(rotations.rotate(one, up), A[0].as_matrix()[:, 2], atol=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_from_axis_angle(axis):
    angles = RNG.uniform(-7, 7, 50)
    same_rotation(rotations.from_axis_angle(axis, angles), Rotation.from_euler("xyz"[axis], angles[:, None]))
    same_rotation(rotations.from_axis_angle(axis, 0.3), Rotation.from_euler("xyz"[axis], 0.3))


def test_rotation_vector():
    # scipy, too, gives the angle at most pi; random rotations stay clear of pi itself, where the sign is free.
    np.testing.assert_allclose(rotations.rotation_vector(ours(A)), A.as_rotvec(), atol=1e-9)
    np.testing.assert_allclose(rotations.rotation_vector(-ours(A)), A.as_rotvec(), atol=1e-9)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-9, 1e-6, 0.1, 3.0, math.pi])
def test_rotation_vector_of_small_and_large_angles(size):
    vector = np.array([0.6, 0.0, 0.8]) * size
    got = rotations.rotation_vector(ours(Rotation.from_rotvec(vector)))
    np.testing.assert_allclose(got, vector, rtol=1e-9, atol=1e-15)


def test_angle_between():
    np.testing.assert_allclose(rotations.angle_between(ours(A), ours(B)), (A.inv() * B).magnitude(), atol=1e-9)
    np.testing.assert_allclose(rotations.angle_between(ours(A), -ours(A)), 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("q", "expected"),
    [
        ([1, 0, 0, 0], [1, 0, 0, 0]),
        ([-1, 0, 0, 0], [1, 0, 0, 0]),
        ([2, 0, 0, 0], [1, 0, 0, 0]),
        ([3, 0, -4, 0], [0.6, 0, -0.8, 0]),
        ([-3, 0, -4, 0], [0.6, 0, 0.8, 0]),
        ([-0.5, 0.5, 0.5, 0.5], [0.5, -0.5, -0.5, -0.5]),
    ],
)
def test_canonical(q, expected):
    np.testing.assert_allclose(rotations.canonical(np.array(q, dtype=float)), expected, atol=1e-15)


def test_canonical_is_the_same_rotation_whichever_sign_it_is_given():
    q = rotations.canonical(ours(A))
    same_rotation(q, A)
    assert (q[:, 0] >= 0).all()
    np.testing.assert_array_equal(q, rotations.canonical(-ours(A)))
    np.testing.assert_allclose(rotations.canonical(q), q, atol=1e-15)


def test_from_matrix_is_the_inverse_of_matrix():
    half_turns = [Rotation.from_rotvec(np.pi * axis) for axis in np.eye(3)]
    for rotation in [*A[:50], *half_turns, Rotation.identity()]:
        found = rotations.from_matrix(rotation.as_matrix())
        assert found[0] >= 0
        same_rotation(found, rotation)
        np.testing.assert_allclose(rotations.matrix(found), rotation.as_matrix(), atol=1e-12)


def test_from_own_angles():
    angles = RNG.uniform(-3, 3, (N, 3))
    same_rotation(rotations.from_own_angles(angles), Rotation.from_euler("XYZ", angles))
    np.testing.assert_array_equal(rotations.from_own_angles(angles[0]), rotations.from_own_angles(angles)[0])
