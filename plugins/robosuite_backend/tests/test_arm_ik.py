"""The simulator-free kinematics agree with MuJoCo's."""

from __future__ import annotations

import mujoco
import numpy as np

from causalbench.backend import arm_ik
from causalbench_mujoco.arms import HAND
from causalbench_robosuite.world import PandaWorld


def test_pose_and_jacobian_are_those_of_mujoco() -> None:
    world, rng = PandaWorld(0.002, n_fixtures=1), np.random.default_rng(0)
    site = world.model.site(HAND).id
    position, rotation, jacobian = np.empty(3), np.empty((3, 3)), np.empty((6, 7))
    full = np.empty((6, world.model.nv))
    for _ in range(20):
        q = rng.uniform(-1.5, 1.5, 7)
        world.views.qpos[world.robot.joints] = q
        mujoco.mj_kinematics(world.model, world.data)
        mujoco.mj_comPos(world.model, world.data)
        mujoco.mj_jacSite(world.model, world.data, full[:3], full[3:], site)
        arm_ik.forward(world.chain, q, position, rotation, jacobian)
        assert np.allclose(position, world.views.position, atol=1e-12)
        assert np.allclose(rotation.ravel(), world.views.matrix, atol=1e-12)
        assert np.allclose(jacobian, full[:, world.robot.dofs], atol=1e-12)
