"""Snapshots are exact: in motion, in contact and with the box in the hand; in other scenes and processes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from causalbench.core.env import StageTaskEnv
from causalbench.core.scene import Scene
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.errors import CausalbenchError, SnapshotError
from causalbench_pybullet import make


def play(scene: Scene, seed: int = 0, steps: int = 15) -> bytes:
    """Everything the facts say during random motion with the gripper left alone."""
    rng = np.random.default_rng(seed)
    out = b""
    for _ in range(steps):
        action = rng.uniform(-0.5, 0.5, 7)
        action[6] = 0.0
        scene.step(action)
        facts = scene.facts()
        out += b"".join(np.asarray(getattr(facts, name)).tobytes() for name in facts.__slots__)
    return out


def free(scene: Scene) -> bytes:
    StageTaskEnv(TASK, scene).reset(seed=3)
    play(scene, 1, 5)
    return scene.snapshot()


def pressing(scene: Scene) -> bytes:
    StageTaskEnv(TASK, scene).reset(seed=4)
    down = np.zeros(7)
    down[2] = -1.0
    for _ in range(30):
        scene.step(down)
        if scene.facts().collision_arm:
            break
    assert scene.facts().collision_arm
    return scene.snapshot()


@pytest.fixture(params=["free", "pressing", "grasping"])
def snapshot(request: pytest.FixtureRequest, scene: Scene) -> bytes:
    if request.param == "grasping":
        return request.getfixturevalue("grasped").snapshot()
    return {"free": free, "pressing": pressing}[request.param](scene)


def test_a_restored_scene_goes_on_bit_for_bit(scene: Scene, snapshot: bytes) -> None:
    facts = scene.facts()
    first = play(scene)
    StageTaskEnv(TASK, scene).reset(seed=9)
    play(scene, 7, 5)
    scene.restore(snapshot)
    assert all(np.array_equal(getattr(facts, n), getattr(scene.facts(), n)) for n in facts.__slots__)
    assert play(scene) == first
    other = make()
    other.restore(snapshot)
    assert play(other) == first


def test_another_process_goes_on_bit_for_bit(scene: Scene, snapshot: bytes, tmp_path: Path) -> None:
    (tmp_path / "snapshot").write_bytes(snapshot)
    script = (
        "import sys, pathlib; folder = pathlib.Path(sys.argv[1]); sys.path.insert(0, sys.argv[2])\n"
        "from causalbench_pybullet import make; from test_snapshot import play\n"
        "scene = make(); scene.restore((folder / 'snapshot').read_bytes())\n"
        "(folder / 'trace').write_bytes(play(scene))"
    )
    command = [sys.executable, "-c", script, str(tmp_path), str(Path(__file__).parent)]
    subprocess.run(command, check=True, timeout=120)
    scene.restore(snapshot)
    assert play(scene) == (tmp_path / "trace").read_bytes()


def test_a_seed_means_the_same_in_another_process(scene: Scene, tmp_path: Path) -> None:
    script = (
        "import sys, pathlib; folder = pathlib.Path(sys.argv[1]); sys.path.insert(0, sys.argv[2])\n"
        "from causalbench_pybullet import make; from test_snapshot import free, play\n"
        "scene = make(); free(scene); (folder / 'trace').write_bytes(play(scene))"
    )
    command = [sys.executable, "-c", script, str(tmp_path), str(Path(__file__).parent)]
    subprocess.run(command, check=True, timeout=120)
    free(scene)
    assert play(scene) == (tmp_path / "trace").read_bytes()


def test_foreign_bytes_are_refused(scene: Scene) -> None:
    mine = free(scene)
    other = make(control_hz=20.0)
    theirs = free(other)
    for foreign in (b"", b"nonsense", theirs, mine[:-8], mine + b"\0" * 8):
        with pytest.raises(SnapshotError):
            scene.restore(foreign)


def test_there_is_nothing_to_snapshot_before_the_first_reset() -> None:
    with pytest.raises(CausalbenchError, match="reset"):
        make().snapshot()
