"""The compiled helpers: against scipy, and bit for bit against their numpy face."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve
from scipy.spatial.transform import Rotation

from causalbench.core.numerics import kernels, linear, rotations

RANDOM = Rotation.random(300, random_state=0)
HALF_TURNS = [Rotation.from_rotvec(np.pi * axis) for axis in np.eye(3)]
ALL = [*RANDOM, *HALF_TURNS, Rotation.identity()]


def quaternion(rotation: Rotation) -> np.ndarray:
    return np.roll(rotation.as_quat(), 1)


@pytest.mark.parametrize("rotation", ALL[::25] + HALF_TURNS)
def test_rodrigues(rotation: Rotation) -> None:
    vector, out = rotation.as_rotvec(), np.empty((3, 3))
    angle = float(np.linalg.norm(vector))
    kernels.axis_rotation(vector / angle, angle, out)
    np.testing.assert_allclose(out, rotation.as_matrix(), atol=1e-14)


def test_matrix_is_bit_for_bit_that_of_the_numpy_face() -> None:
    for rotation in ALL:
        out = np.empty((3, 3))
        kernels.matrix(quaternion(rotation), out)
        np.testing.assert_allclose(out, rotation.as_matrix(), atol=1e-14)
        np.testing.assert_array_equal(out, rotations.matrix(quaternion(rotation)))


def test_from_matrix_is_bit_for_bit_that_of_the_numpy_face() -> None:
    for rotation in ALL:
        matrix, out = rotation.as_matrix(), np.empty(4)
        kernels.from_matrix(matrix.ravel(), out)
        np.testing.assert_allclose(np.abs(out @ quaternion(rotation)), 1.0, atol=1e-14)
        np.testing.assert_array_equal(out, rotations.from_matrix(matrix))


def test_canonical_is_bit_for_bit_that_of_the_numpy_face() -> None:
    for rotation in ALL:
        for q in (1.5 * quaternion(rotation), -quaternion(rotation)):
            out = np.empty(4)
            kernels.canonical(*q, out)
            np.testing.assert_array_equal(out, rotations.canonical(q))


def test_rotation_vector() -> None:
    out = np.empty(3)
    for first, second in zip(ALL, ALL[::-1], strict=True):
        kernels.rotation_vector(first.as_matrix(), second.as_matrix(), out)
        np.testing.assert_allclose(out, (first * second.inv()).as_rotvec(), atol=1e-7)
    for half in HALF_TURNS:  # where the skew part vanishes
        kernels.rotation_vector(half.as_matrix(), np.eye(3), out)
        np.testing.assert_allclose(np.abs(out), np.abs(half.as_rotvec()), atol=1e-12)


def test_unturned() -> None:
    out = np.empty(4)
    for yaw, rotation in zip(np.linspace(-4, 4, len(ALL)), ALL, strict=True):
        kernels.unturned(yaw, quaternion(rotation), out)
        expected = Rotation.from_rotvec([0, 0, -yaw]) * rotation
        np.testing.assert_allclose(np.abs(out @ quaternion(expected)), 1.0, atol=1e-14)


@pytest.mark.parametrize("n", [3, 6, 7])
@pytest.mark.parametrize(("factor", "substitute"), [("cholesky", "cholesky_solve"), ("ldl", "ldl_solve")])
def test_systems_are_solved_as_by_scipy(n: int, factor: str, substitute: str) -> None:
    rng = np.random.default_rng(n)
    for _ in range(20):
        half = rng.normal(size=(n, n))
        a, b = half @ half.T + 0.1 * np.eye(n), rng.normal(size=n)
        lower, x = np.tril(a) + np.triu(np.full((n, n), np.nan), 1), b.copy()  # the upper part is not read
        getattr(linear, factor)(lower, n)
        getattr(linear, substitute)(lower, n, x)
        np.testing.assert_allclose(x, solve(a, b, assume_a="pos"), rtol=1e-8)
