from __future__ import annotations

import numpy as np
import pytest

from causalbench.core.env import StageTaskEnv
from causalbench.core.scene import Scene
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench_pybullet import make


@pytest.fixture(scope="session")
def scene() -> Scene:
    return make()


@pytest.fixture
def grasped(scene: Scene) -> Scene:
    """The scene with the box in the hand, seed 0."""
    env = StageTaskEnv(TASK, scene)
    env.reset(seed=0)
    for _ in range(TASK.horizon):
        if env.step(TASK.expert(env.facts, scene.spec))[2]:
            break
    assert scene.facts().holding
    closing = np.zeros(7)
    closing[6] = 1.0
    scene.step(closing)
    return scene
