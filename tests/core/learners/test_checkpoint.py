"""Checkpoints: a run that was stopped anywhere and repeated ends with the bits of one that was not."""

from __future__ import annotations

import ast
import dataclasses
import json
import random
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file
from training import METHOD, train

import causalbench
from causalbench import formats
from causalbench.core.discovery.graph import manual_graph
from causalbench.core.kinematic.scenes import WorldsScene
from causalbench.core.kinematic.worlds import KinematicWorlds
from causalbench.core.learners import examiner
from causalbench.core.learners.checkpoint import Checkpoints, load_checkpoint, save_checkpoint
from causalbench.core.learners.ppo.agent import PPOAgent
from causalbench.core.learners.ppo.settings import PPOSettings
from causalbench.core.learners.records import Evaluation
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.learners.settings import EvaluationSettings
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.errors import CheckpointError
from causalbench.plugins.manager import installed

SETTINGS = {
    "SAC": SACSettings(net_arch=(8, 8), batch_size=16, learning_starts=16, train_every=4, n_envs=2),
    "PPO": PPOSettings(net_arch=(8, 8), batch_size=16, n_steps=80, n_epochs=2, n_envs=2, decay_steps=300),
}
LOOKS = EvaluationSettings(every=100, episodes=1, final_episodes=1)
STEPS = 300


def _stage(facts):
    """Stripes of the gripper's opening, which actions of every stage move: each agent learns within a few steps."""
    return (np.floor(facts.gripper_opening / 0.012) % 4 + 1).astype(np.int64)


STRIPES = dataclasses.replace(TASK, horizon=20, stage=_stage)


class Kill(Exception):  # noqa: N818 - it stands for a SIGKILL
    """Ends training at a step, where a kill might."""


@dataclasses.dataclass
class Outcome:
    """Everything that training leaves behind."""

    policy: bytes
    counts: str
    updates: dict[int, int]
    evaluations: list[Evaluation]


def run(backend, name, path=None, kill_at=None, make_scene=None, **changes):
    """Train on the stripes, with a `Kill` after `kill_at` steps of this call; `changes`: settings, seed, budget."""
    seen, steps, seed, budget = [], 0, changes.pop("seed", 0), changes.pop("budget", STEPS)
    looks = dataclasses.replace(LOOKS, stop_after=changes.pop("stop_after", 0))

    def on_progress(share, text):
        nonlocal steps
        steps += 1
        if steps == kill_at:
            raise Kill

    policy, counts = train(
        STRIPES,
        make_scene or installed().backend(backend).make,
        METHOD[name],
        manual_graph(STRIPES),
        dataclasses.replace(SETTINGS[METHOD[name].learner], **changes),
        looks,
        budget,
        seed,
        lambda evaluation, counts: seen.append(evaluation),
        on_progress,
        path and Checkpoints(path, every=30),
    )
    weights = torch.cat([w.detach().flatten() for actor in policy.actors for w in actor])
    policy_bytes = weights.numpy().tobytes() + policy.generator.get_state().numpy().tobytes()
    return Outcome(policy_bytes, str(dataclasses.asdict(counts)), counts.updates, seen)


@pytest.mark.parametrize(
    ("backend", "name"),
    [
        ("kinematic", "cmmSAC"),
        ("kinematic", "cSAC"),
        ("kinematic", "cmmPPO"),
        ("kinematic", "mPPO"),
        ("pybullet", "cmmSAC"),
        pytest.param("gymrob", "cSAC", marks=pytest.mark.long),
    ],
)
def test_stopped_anywhere_and_repeated_gives_the_same_bits(backend, name, tmp_path):
    """Checkpoints fall in mid-episode, kills before, between and right after them; every stage has trained."""
    whole = run(backend, name)
    assert all(whole.updates.values())
    path = tmp_path / "checkpoint.safetensors"
    rng = random.Random(f"{backend} {name}")
    for kill_at in [rng.randint(1, 60) for _ in range(4)]:
        with pytest.raises(Kill):
            run(backend, name, path, kill_at=kill_at)
    assert run(backend, name, path) == whole


def test_ppos_learning_rate_falls_linearly_and_stays_at_0(monkeypatch):
    """Epochs of 80 steps: the rate of the first is whole, as in CleanRL, from the third on it is 0."""
    rates = []
    monkeypatch.setattr(PPOAgent, "set_learning_rate", lambda agent, rate: rates.append(rate))
    run("kinematic", "mPPO", decay_steps=160, learning_rate=0.25)
    assert rates == [rate for rate in (0.25, 0.125, 0.0) for _ in range(STRIPES.n_stages)]
    rates.clear()
    run("kinematic", "mPPO", decay_steps=0, learning_rate=0.25)
    assert set(rates) == {0.25}


@pytest.mark.parametrize(("name", "budgets"), [("cmmSAC", (100, 230, 300)), ("cmmPPO", (130, 300))])
def test_a_larger_budget_goes_on_from_the_end_of_a_smaller_one_to_the_same_bits(name, budgets, tmp_path):
    """At an evaluation or beside one: the last evaluation of a smaller budget, and what it draws, leaves no trace."""
    path = tmp_path / "checkpoint.safetensors"
    for budget in budgets:
        found = run("kinematic", name, path, budget=budget)
    assert found == run("kinematic", name)
    assert found.evaluations[-1].env_steps == STEPS


def test_a_run_that_was_settled_goes_on_as_one_with_a_larger_budget_would(tmp_path, monkeypatch):
    monkeypatch.setattr(examiner.Examiner, "_without_failure", lambda self, newest: len(self.evaluations) == 1)
    path = tmp_path / "checkpoint.safetensors"
    small, large = (run("kinematic", "cmmSAC", path, budget=budget, stop_after=2) for budget in (280, 300))
    assert small == large == run("kinematic", "cmmSAC", stop_after=2)
    assert large.evaluations[-1].env_steps == 200


def test_a_checkpoint_beyond_the_budget_is_refused(tmp_path):
    path = tmp_path / "checkpoint.safetensors"
    run("kinematic", "cmmSAC", path, budget=120)
    with pytest.raises(CheckpointError, match="a checkpoint of env step 120, beyond the budget of 100; delete it"):
        run("kinematic", "cmmSAC", path, budget=100)


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """The checkpoint of a run of cmmSAC on kinematic that was stopped after 40 steps of two worlds."""
    path = tmp_path_factory.mktemp("stopped") / "checkpoint.safetensors"
    with pytest.raises(Kill):
        run("kinematic", "cmmSAC", path, kill_at=40)
    return path


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gamma": 0.9}, "settings gamma is 0.99, not 0.9"),
        ({"n_envs": 3}, "settings n_envs is 2, not 3"),
        ({"seed": 1}, "seed is 0, not 1"),
        ({"name": "cSAC"}, "method name is 'cmmSAC', not 'cSAC'"),
        ({"make_scene": lambda: _Newer()}, "worlds backend_version is '1', not '2'"),
    ],
)
def test_a_checkpoint_of_another_run_is_refused(stopped, changes, message):
    before = stopped.read_bytes()
    with pytest.raises(CheckpointError, match=f"{stopped}: a checkpoint of another run, whose {message}; delete it"):
        run("kinematic", **{"name": "cmmSAC", "path": stopped} | changes)
    assert stopped.read_bytes() == before


class _Standing(WorldsScene):
    def __init__(self):
        super().__init__(KinematicWorlds(()))


class _Newer(_Standing):
    def batch(self, n):
        batch = super().batch(n)
        batch.spec = dataclasses.replace(self.spec, backend_version="2")
        return batch


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda path, data: path.write_bytes(data[: len(data) // 2]), "not a checkpoint of causalbench, or damaged"),
        (lambda path, data: path.write_bytes(b"\x80\x04." + data), "not a checkpoint of causalbench, or damaged"),
        (lambda path, data: path.write_bytes(b""), "not a checkpoint of causalbench, or damaged"),
        (lambda path, data: save_file({"a": np.zeros(1)}, path), "not a checkpoint of causalbench, or damaged"),
        (
            lambda path, data: save_file({}, path, {"causalbench": json.dumps({"schema": 0, "identity": {}})}),
            f"schema 0, expected {formats.CHECKPOINT}",
        ),
    ],
    ids=["torn", "pickle", "empty", "another program's", "older"],
)
def test_what_is_no_checkpoint_is_refused(stopped, tmp_path, write, message):
    path = tmp_path / "checkpoint.safetensors"
    write(path, stopped.read_bytes())
    with pytest.raises(CheckpointError, match=message):
        run("kinematic", "cmmSAC", path)


def test_no_flipped_bit_goes_unnoticed(tmp_path):
    path, rng = tmp_path / "checkpoint.safetensors", random.Random(1)
    save_checkpoint(path, {"weights": torch.randn(7, 5), "steps": 30, "rng": {"state": 2**100}}, {"seed": 0})
    content = path.read_bytes()
    for _ in range(2000):
        changed = bytearray(content)
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
        path.write_bytes(bytes(changed))
        with pytest.raises(CheckpointError, match=f"{path}: .*; delete it"):
            load_checkpoint(path, {"seed": 0})


def test_a_write_that_dies_leaves_the_old_checkpoint(stopped, tmp_path, monkeypatch):
    path = tmp_path / "checkpoint.safetensors"
    path.write_bytes(stopped.read_bytes())

    def die(descriptor):
        raise Kill

    monkeypatch.setattr("os.fsync", die)
    with pytest.raises(Kill):
        save_checkpoint(path, {"a": torch.zeros(3)}, {})
    assert path.read_bytes() == stopped.read_bytes()


def test_values_come_back_bit_for_bit(tmp_path):
    path, rng = tmp_path / "checkpoint.safetensors", np.random.default_rng(3)
    state = {
        "scalar": torch.tensor(2.5),
        "none": torch.zeros(0, 3),
        "flags": np.array([True, False]),
        "turned": torch.arange(6).reshape(2, 3).T,
        "float": 0.1 + 0.2,
        "rng": rng.bit_generator.state,
    }
    save_checkpoint(path, state, {"sizes": (1, 2)})
    found = load_checkpoint(path, {"sizes": [1, 2]})
    for name in ("scalar", "none", "flags", "turned"):
        assert torch.equal(found[name], torch.as_tensor(state[name]))
    assert (found["float"], found["rng"]) == (state["float"], state["rng"])
    assert load_checkpoint(tmp_path / "none", {}) is None


class _Inexact(_Standing):
    def batch(self, n):
        batch = super().batch(n)
        batch.spec = dataclasses.replace(self.spec, capabilities=frozenset())
        return batch


def test_a_backend_that_does_not_restore_exactly_starts_again(tmp_path, caplog):
    path = tmp_path / "checkpoint.safetensors"
    caplog.set_level("INFO", "causalbench")
    with pytest.raises(Kill):
        run("kinematic", "mSAC", path, kill_at=40, make_scene=_Inexact)
    assert not path.exists()
    assert "does not restore exactly" in caplog.text
    assert run("kinematic", "mSAC", path, make_scene=_Inexact) == run("kinematic", "mSAC")


def test_nothing_that_reads_a_run_folder_can_run_code():
    """safetensors and JSON only: no unpickling in any layer that reads one."""
    package = Path(causalbench.__file__).parent
    forbidden = {"torch.load", "pickle.load", "pickle.loads", "pickle.Unpickler", "marshal.loads", "eval", "exec"}
    for path in (path for layer in ("core", "store", "run", "report") for path in (package / layer).rglob("*.py")):
        calls = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
        assert not forbidden & {ast.unparse(call.func) for call in calls}, path
        arrays = [ast.unparse(call) for call in calls if ast.unparse(call.func) == "np.load"]
        assert all("allow_pickle=False" in call for call in arrays), path
