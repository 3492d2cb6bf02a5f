"""A reset gives what the layout says, whatever the scene did before."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from causalbench.core.layout import Box, Layout
from causalbench.core.scene import Scene
from causalbench.core.tasks import pure_manipulation as task
from causalbench.errors import UnreachableLayoutError
from causalbench_gymrob import make

UP = np.array([0.0, 0.0, 1.0])


def layouts(scene: Scene, seed: int, count: int) -> list[Layout]:
    rng = np.random.default_rng(seed)
    return [
        task.draw_layout(rng, scene.spec.workspace, scene.spec.max_opening, 1 + i % task.N_STAGES) for i in range(count)
    ]


def walk(scene: Scene, seed: int, steps: int = 15) -> NDArray[np.float64]:
    """Hand and object poses (steps, 14) under random actions."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(steps):
        scene.step(rng.uniform(-1, 1, 7))
        f = scene.facts()
        rows.append(np.concatenate([f.eef_position, f.eef_quaternion, f.object_position, f.object_quaternion]))
    return np.array(rows)


def test_a_start_inside_the_table_is_refused(scene: Scene) -> None:
    layout = layouts(scene, 1, 1)[0]
    sunk = dataclasses.replace(layout.target, position=layout.target.position - UP * 0.02)
    with pytest.raises(UnreachableLayoutError):
        scene.reset(dataclasses.replace(layout, target=sunk))


def test_sizes_set_later_act_like_sizes_compiled_first() -> None:
    """No trace of an earlier layout is left: masses, bounding volumes, fixtures or solver state."""
    used, fresh = make(), make()
    layout = layouts(used, 2, 1)[0]
    big = Box("shelf", np.array([0.1, 0.1, 0.05]), np.array([0.35, 0.75, 0.65]), np.array([1.0, 0.0, 0.0, 0.0]))
    target = dataclasses.replace(layout.target, half_extents=np.array([0.02, 0.03, 0.025]))
    used.reset(dataclasses.replace(layout, fixtures=(*layout.fixtures, big), target=target, target_mass=1.5))
    walk(used, 0)
    small = dataclasses.replace(layout.fixtures[0], half_extents=layout.fixtures[0].half_extents * [0.9, 0.9, 1.0])
    used.reset(dataclasses.replace(layout, fixtures=(small,)))
    walk(used, 1)
    used.reset(layout)
    fresh.reset(layout)
    assert np.array_equal(walk(used, 3, 40), walk(fresh, 3, 40))


def test_a_box_lies_on_a_second_fixture(scene: Scene) -> None:
    layout = layouts(scene, 2, 1)[0]
    top = np.array([0.1, 0.1, 0.02])
    shelf = Box("shelf", top, layout.target.position + UP * (top[2] - 0.025), np.array([1.0, 0.0, 0.0, 0.0]))
    raised = dataclasses.replace(layout.target, position=layout.target.position + UP * 2 * top[2])
    scene.reset(dataclasses.replace(layout, fixtures=(*layout.fixtures, shelf), target=raised))
    for _ in range(20):
        scene.step(np.zeros(7))
    assert np.abs(scene.facts().object_position - raised.position).max() < 1e-3
