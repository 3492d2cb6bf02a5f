"""What the dense variant pays beside pure manipulation, and that it is another task."""

import numpy as np
import pytest

from causalbench.core.kinematic import make
from causalbench.core.staged.scene_worlds import make_scene_worlds
from causalbench.core.tasks.pure_manipulation import TASK as SPARSE
from causalbench.core.tasks.pure_manipulation_dense import TASK
from causalbench.suite.task_identity import task_identity

GRIPPER = TASK.term_names.index("r_gripper")


@pytest.mark.parametrize(("stage", "grip"), [(1, 1.0), (3, 1.0), (4, 1.0), (4, 0.5), (4, -1.0)])
def test_only_closing_in_stage_4_is_paid_and_opening_costs_as_much(stage, grip):
    found = {}
    for task in (SPARSE, TASK):
        worlds = make_scene_worlds(task, make)
        worlds.reset([0], [np.random.default_rng(3)], stage)
        before = worlds.facts.gripper_opening
        step = worlds.step(np.array([0.0] * 6 + [grip]))
        found[task.name] = step.rewards, float(before - worlds.facts.gripper_opening)
        worlds.close()
    (sparse, _), (dense, closed) = found[SPARSE.name], found[TASK.name]
    expected = sparse.copy()
    expected[GRIPPER] += 10.0 * closed if stage == 4 else 0.0
    np.testing.assert_allclose(dense, expected, atol=1e-12)
    assert closed != 0 or stage < 4 or grip < 0  # a gripper that is wide open opens no further


def test_it_is_another_task():
    ours, theirs = task_identity(TASK), task_identity(SPARSE)
    assert ours.name != theirs.name
    assert ours.behaviour != theirs.behaviour
    assert ours.data["constants"] != theirs.data["constants"]
