"""A chain from what a simulator tells at zero, against one put together from frames."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from causalbench.core.kit import arm_ik


def test_a_chain_at_zero_moves_as_the_one_it_was_read_from() -> None:
    rng = np.random.default_rng(0)
    n = 6
    axes = rng.normal(size=(n, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    limits = np.tile([-3.0, 3.0], (n, 1))
    turns = Rotation.random(n + 1, random_state=1).as_matrix()
    frames = arm_ik.Chain(turns, rng.normal(size=(n + 1, 3)), axes, limits)
    # At zero: where the joints are, and which way they point, one fixed transform after the other.
    position, rotation, anchors, directions = np.zeros(3), np.eye(3), [], []
    for i in range(n):
        position, rotation = position + rotation @ frames.offsets[i], rotation @ turns[i]
        anchors.append(position)
        directions.append(rotation @ axes[i])
    position, rotation = position + rotation @ frames.offsets[n], rotation @ turns[n]
    chain = arm_ik.chain_at_zero(np.array(anchors), np.array(directions), limits, position, rotation)
    for _ in range(10):
        q = rng.uniform(-2.0, 2.0, n)
        for found, expected in zip(arm_ik.pose(chain, q), arm_ik.pose(frames, q), strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-12)
