"""The simulator-free kinematics agree with MuJoCo's and with themselves."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from causalbench.backend import UnreachableLayoutError, arm_ik, fetch, joint_following
from causalbench_gymrob import model
from causalbench_gymrob.scene import FetchWorld
from causalbench_mujoco.arms import HAND


@pytest.fixture(scope="module")
def world() -> FetchWorld:
    return FetchWorld(0.005, n_fixtures=1)


def test_pose_and_jacobian_are_those_of_mujoco(world: FetchWorld) -> None:
    rng = np.random.default_rng(0)
    site = world.model.site(HAND).id
    dofs = [int(world.model.joint(name).dofadr[0]) for name in model.ARM_JOINTS]
    position, rotation, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, 7))
    full = np.empty((6, world.model.nv))
    for _ in range(20):
        world.arm_joints[:] = rng.uniform(-1.5, 1.5, 7)
        mujoco.mj_kinematics(world.model, world.data)
        mujoco.mj_comPos(world.model, world.data)
        mujoco.mj_jacSite(world.model, world.data, full[:3], full[3:], site)
        arm_ik.forward(world.chain, world.arm_joints.copy(), position, rotation, jacobian)
        assert np.allclose(position, world.hand_position, atol=1e-12)
        assert np.allclose(rotation.ravel(), world.hand_matrix, atol=1e-12)
        assert np.allclose(jacobian, full[:, dofs], atol=1e-12)


def test_solve_finds_what_forward_gives(world: FetchWorld) -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        q = np.array([0.0, -0.6, 0.0, 1.5, 0.0, 0.3, 0.0]) + rng.uniform(-0.3, 0.3, 7)
        position, rotation = arm_ik.pose(world.chain, q)
        found_position, found_rotation = arm_ik.pose(
            world.chain, arm_ik.solve(world.chain, position, rotation, fetch.ARM_STARTS)
        )
        assert np.allclose(found_position, position, atol=1e-4)
        assert np.allclose(found_rotation, rotation, atol=1e-4)


def test_solve_refuses_what_is_out_of_reach(world: FetchWorld) -> None:
    with pytest.raises(UnreachableLayoutError, match="cannot take the pose"):
        arm_ik.solve(world.chain, np.array([2.0, 0.0, 0.8]), np.eye(3), fetch.ARM_STARTS)


def test_targets_stay_within_limits_and_near_the_joints(world: FetchWorld) -> None:
    low, high = world.chain.limits.T
    target = np.clip(np.array(fetch.ARM_STARTS[0]), low, high)
    rng = np.random.default_rng(2)
    for _ in range(300):
        measured = target.copy()
        delta = rng.choice([-1.0, 1.0], 6) * np.repeat([0.005, 0.02], 3)
        joint_following.follow(world.chain, target, measured, delta, 0.025)
        assert (target >= low).all()
        assert (target <= high).all()
        assert np.abs(target - measured).max() <= joint_following.LEAD + 1e-12
