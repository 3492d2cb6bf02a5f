"""The task is solvable with what the scene's facts say, and the grasps it ends in bear load."""

from __future__ import annotations

import pytest

from causalbench.core.env import StageTaskEnv
from causalbench.core.scene import Scene
from causalbench.core.tasks.hold_test import lift_and_hold
from causalbench.core.tasks.pure_manipulation import TASK


@pytest.mark.parametrize("first", range(0, 50, 10))
def test_the_expert_grasps_without_collision_and_the_grasp_holds(scene: Scene, first: int) -> None:
    env = StageTaskEnv(TASK, scene)
    for seed in range(first, first + 10):
        env.reset(seed=seed)
        done = success = False
        while not done:
            _, _, success, truncated, _ = env.step(TASK.expert(env.facts, scene.spec))
            facts = env.facts
            collided = facts.collision_arm or facts.collision_self or facts.collision_base
            assert not collided, seed
            done = success or truncated
        assert success, seed
        assert lift_and_hold(scene), seed
