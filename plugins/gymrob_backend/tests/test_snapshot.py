"""What conformance cannot ask of snapshots: scenes of another spec, and scenes before their first reset."""

from __future__ import annotations

import pytest

from causalbench.core.env import StageTaskEnv
from causalbench.core.scene import Scene
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.errors import CausalbenchError, SnapshotError
from causalbench_gymrob import make


def test_a_snapshot_of_another_spec_is_refused(scene: Scene) -> None:
    other = make(control_hz=20.0)
    StageTaskEnv(TASK, other).reset(seed=3)
    with pytest.raises(SnapshotError, match="another spec"):
        scene.restore(other.snapshot())


def test_there_is_nothing_to_snapshot_before_the_first_reset() -> None:
    with pytest.raises(CausalbenchError, match="reset"):
        make().snapshot()
