"""What holds in every simulator and conformance does not ask."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks import pure_manipulation as task
from causalbench.core.tasks.lift_and_hold import lift_and_hold
from causalbench.core.world.layout import Box, Layout
from causalbench.core.world.scene import Scene
from causalbench.errors import CausalbenchError, SnapshotError, UnreachableLayoutError, UserError
from causalbench.plugins.backends import Backend
from causalbench.plugins.manager import installed

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module", params=["gymrob", "pybullet", "robosuite"])
def simulator(request: pytest.FixtureRequest) -> Backend:
    return installed().backend(request.param)


@pytest.fixture(scope="module")
def scene(simulator: Backend) -> Iterator[Scene]:
    scene = simulator.make()
    yield scene
    scene.close()


def layout(scene: Scene, seed: int) -> Layout:
    return task.draw_layout(np.random.default_rng(seed), scene.spec.workspace, scene.spec.max_opening, 1)


def raised(box: Box, height: float) -> Box:
    return dataclasses.replace(box, position=box.position + np.array([0.0, 0.0, height]))


def walk(scene: Scene, seed: int, steps: int) -> NDArray[np.float64]:
    """Hand and object poses (steps, 14) under random actions."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(steps):
        scene.step(rng.uniform(-1, 1, 7))
        f = scene.facts()
        rows.append(np.concatenate([f.eef_position, f.eef_quaternion, f.object_position, f.object_quaternion]))
    return np.array(rows)


@pytest.mark.parametrize("first", range(0, 50, 10))
def test_the_expert_grasps_without_collision_and_the_grasp_holds(scene: Scene, first: int) -> None:
    env = StageTaskEnv(SceneWorlds(task.TASK, scene))
    for seed in range(first, first + 10):
        env.reset(seed=seed)
        done = success = False
        while not done:
            _, _, success, truncated, _ = env.step(env.worlds.expert())
            facts = env.worlds.facts
            collided = facts.collision_arm or facts.collision_self or facts.collision_base
            assert not collided, seed
            done = success or truncated
        assert success, seed
        assert lift_and_hold(scene), seed


def test_a_start_inside_the_table_is_refused(scene: Scene) -> None:
    start = layout(scene, 1)
    with pytest.raises(UnreachableLayoutError):
        scene.reset(dataclasses.replace(start, target=raised(start.target, -0.02)))


def test_a_start_depends_on_nothing_that_was_before(scene: Scene, simulator: Backend) -> None:
    """No trace of an earlier layout is left: sizes, masses, fixtures, bounding volumes or memory of contacts."""
    start = layout(scene, 2)
    shelf = Box("shelf", np.array([0.1, 0.1, 0.05]), np.array([0.35, 0.75, scene.spec.workspace.table_height]), UPRIGHT)
    target = dataclasses.replace(start.target, half_extents=np.array([0.02, 0.03, 0.025]))
    scene.reset(dataclasses.replace(start, fixtures=(*start.fixtures, shelf), target=target, target_mass=1.5))
    walk(scene, 0, 15)
    small = dataclasses.replace(start.fixtures[0], half_extents=start.fixtures[0].half_extents * [0.9, 0.9, 1.0])
    scene.reset(dataclasses.replace(start, fixtures=(small,)))
    walk(scene, 1, 15)
    fresh = simulator.make()
    for each in (scene, fresh):
        each.reset(start)
    assert np.array_equal(walk(scene, 3, 40), walk(fresh, 3, 40))
    fresh.close()


@pytest.mark.parametrize("name", ["gymrob", "robosuite"])
def test_a_reset_keeps_the_compiled_model(name: str) -> None:
    scene = installed().backend(name).make()
    model = scene.model
    for seed, height in ((2, 0.0), (2, 0.005), (3, 0.0)):
        start = layout(scene, seed)
        larger = dataclasses.replace(start.target, half_extents=start.target.half_extents + [0.0, 0.0, height])
        scene.reset(dataclasses.replace(start, target=raised(larger, height)))
        assert scene.model is model
    scene.close()


def test_a_box_lies_on_a_second_fixture(scene: Scene) -> None:
    start, half = layout(scene, 2), np.array([0.1, 0.1, 0.02])
    at = start.target.position + np.array([0.0, 0.0, half[2] - start.target.half_extents[2]])
    target = raised(start.target, 2 * half[2])
    scene.reset(dataclasses.replace(start, fixtures=(*start.fixtures, Box("shelf", half, at, UPRIGHT)), target=target))
    for _ in range(20):
        scene.step(np.zeros(7))
    assert np.abs(scene.facts().object_position - target.position).max() < 1e-3


def test_a_snapshot_of_another_spec_is_refused(scene: Scene, simulator: Backend) -> None:
    other = simulator.make(control_hz=20.0)
    StageTaskEnv(SceneWorlds(task.TASK, other)).reset(seed=3)
    with pytest.raises(SnapshotError, match="another spec"):
        scene.restore(other.snapshot())
    other.close()


def test_there_is_nothing_to_snapshot_before_the_first_reset(simulator: Backend) -> None:
    with pytest.raises(CausalbenchError, match="reset"):
        simulator.make().snapshot()


def test_a_control_step_must_be_whole(simulator: Backend) -> None:
    with pytest.raises(UserError, match="whole number"):
        simulator.make(control_hz=10.0, timestep=0.003)
