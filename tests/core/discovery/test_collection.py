"""Samples: kept as plain files, reused only when whole, equal for any number of processes; and bad input."""

import dataclasses
import json
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from scenes import discover
from toy import make_toy, toy_task

from causalbench.core.discovery.methods.kl.settings import KLSettings
from causalbench.core.discovery.pipeline import discover_from_samples
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.kinematic import make
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.errors import InvalidGraphError
from causalbench.store.samples import SampleFolder

TINY = DiscoverySettings(training_count=64, options=KLSettings(max_epochs=1))


def _quiet(share, doing):
    pass


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    """(graph, folder of its samples) of a tiny discovery on kinematic."""
    folder = tmp_path_factory.mktemp("collected") / "data"
    return discover(TASK, make, TINY, 3, _quiet, store=SampleFolder(folder)), folder


def test_the_files_need_numpy_and_pandas_alone(collected):
    _, folder = collected
    sets = ["random", "inference", *(f"do-{action}" for action in TASK.actions), "placebo"]
    assert {p.name for p in folder.iterdir()} == {f"stage{i}-{name}.npz" for i in (1, 2, 3, 4) for name in sets}
    with np.load(folder / "stage1-do-armz.npz", allow_pickle=False) as file:
        actions = pd.DataFrame(file["actions"], columns=file["action_names"])
        assert list(file["reward_names"]) == ["r_eefx", "r_eefy", "r_eefz1", "r_gripper"]
        assert [*file["state_names"]] == [*TASK.state_names, "gripper_opening", *TASK.feature_names]
        assert len(file["states"]) == len(file["rewards"]) == len(file["sequence"]) == len(actions) == 64
        about = json.loads(str(file["about"]))
    assert 0.3 < (actions.armz == 0).mean() < 0.7
    assert list(actions.columns) == [*TASK.actions, *(f"placebo{p}" for p in range(TINY.n_placebos))]
    assert (about["request"]["seed"], about["units"]["actions"]) == (3, "share of full speed, -1 to 1; 0: not executed")


def test_a_colleague_without_causalbench_reads_them(collected):
    _, folder = collected
    code = (
        "import sys, numpy as np, pandas as pd\n"
        f"d = np.load({str(folder / 'stage4-random.npz')!r})\n"
        "print(pd.DataFrame(d['states'], columns=d['state_names']).join(\n"
        "    pd.DataFrame(d['rewards'], columns=d['reward_names'])).shape)\n"
        "print(any(name.startswith('causalbench') for name in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == ["(64, 23)", "False"]


class Interrupted(SampleFolder):
    """Ctrl-C once three sets are there."""

    def save(self, about, samples, task):
        super().save(about, samples, task)
        if len(list(self.path.iterdir())) == 3:
            raise KeyboardInterrupt


def test_an_interrupted_discovery_continues_where_it_was(collected, tmp_path):
    graph, _ = collected
    with pytest.raises(KeyboardInterrupt):
        discover(TASK, make, TINY, 3, _quiet, store=Interrupted(tmp_path))
    stamp = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert len(stamp) == 3
    assert discover(TASK, make, TINY, 3, _quiet, store=SampleFolder(tmp_path)).hash == graph.hash
    assert all(path.stat().st_mtime_ns == then for path, then in stamp.items())


def test_inference_on_the_files_gives_the_same_graph_and_imports_no_simulator(collected, command, tmp_path):
    graph, folder = collected
    store = SampleFolder(folder)
    origin, about = store.origin()
    assert about["seed"] == 3
    assert discover_from_samples(TASK, store, origin, TINY, 3, _quiet).hash == graph.hash
    code = (
        "import sys; from causalbench.cli.app import app\n"
        f"app(['discover', '--data', {str(folder)!r}, '--out', {str(tmp_path)!r}], standalone_mode=False)\n"
        "print('MODULES', *sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {"mujoco", "pybullet", "robosuite"}.isdisjoint(done.stdout.partition("MODULES")[2].split())
    found = json.loads((tmp_path / "graph.json").read_text())
    assert found["provenance"]["data_sha256"] == graph.provenance["data_sha256"]
    assert found["env_steps"] == graph.env_steps
    done = subprocess.run([*command, "discover", "--data", str(tmp_path / "none")], capture_output=True, text=True)
    assert (done.returncode, "no samples here" in done.stderr) == (2, True)


def test_samples_that_are_there_are_used_and_half_written_ones_are_not(collected, tmp_path):
    graph, folder = collected
    copy = tmp_path / "data"
    copy.mkdir()
    for path in folder.iterdir():
        (copy / path.name).write_bytes(path.read_bytes())
    whole = (copy / "stage2-random.npz").read_bytes()
    (copy / "stage2-random.npz").write_bytes(whole[: len(whole) // 2])
    (copy / "stage3-do-grip.npz").unlink()
    stamp = {path.name: path.stat().st_mtime_ns for path in copy.iterdir()}
    again = discover(TASK, make, TINY, 3, _quiet, store=SampleFolder(copy))
    assert (again.hash, again.env_steps) == (graph.hash, graph.env_steps)
    assert (copy / "stage2-random.npz").read_bytes() == whole
    changed = {path.name for path in copy.iterdir() if path.stat().st_mtime_ns != stamp.get(path.name)}
    assert changed == {"stage2-random.npz", "stage3-do-grip.npz"}
    other_seed = discover(TASK, make, TINY, 4, _quiet, store=SampleFolder(copy))
    assert other_seed.provenance["data_sha256"] != graph.provenance["data_sha256"]


def test_the_number_of_processes_changes_nothing(tmp_path):
    settings = dataclasses.replace(TINY, training_count=160)  # large enough for processes to be started
    one = discover(TASK, make, settings, 0, _quiet)
    two = discover(TASK, make, settings, 0, _quiet, cores=2, store=SampleFolder(tmp_path))
    assert (one.hash, one.env_steps) == (two.hash, two.env_steps)


# Bad input: what a graph says about it.


def _rewards(previous, action, now):
    return np.stack([action[:, 0], action[:, 1]], axis=1)


def _graph(task, count=200):
    return discover(
        task, make_toy, DiscoverySettings(training_count=count, options=KLSettings(max_epochs=2)), 0, _quiet
    )


def test_a_stage_that_is_never_reached_is_not_discovered_and_no_policy_is_built_on_that():
    task = dataclasses.replace(toy_task(_rewards, 2), stage=lambda facts: np.full(facts.eef_position.shape[:-1], 2))
    graph = _graph(task)
    (stage,) = graph.stages
    assert not stage.testable.any()
    assert stage.causal_actions() == ("armz",)  # the declared graph
    assert stage.notes[0].startswith("not discovered, the declared graph stands in: task 'toy' found no start in stage")
    with pytest.raises(InvalidGraphError, match="discovery could decide nothing: not discovered, the declared"):
        graph.check(task)


def test_a_stage_that_is_left_at_once_is_decided_and_noted():
    task = toy_task(_rewards, 2)
    # A hand that has taken a step is off the grid of starts.
    on_grid = dataclasses.replace(
        task,
        draw_layout=lambda rng, *rest: dataclasses.replace(
            task.draw_layout(rng, *rest), eef_position=rng.integers(-4, 5, 3) / 4
        ),
        stage=lambda facts: np.where((facts.eef_position * 4 % 1 == 0).all(1), 1, 2),
    )
    (found,) = _graph(on_grid).stages
    assert "every random step left the stage, so that each sample is a first step" in found.notes
    assert found.testable.all()


def test_a_reward_that_never_varies_is_named():
    task = toy_task(lambda p, a, n: np.stack([a[:, 0], np.full(len(a), -0.5)], axis=1), 2)
    (stage,) = _graph(task).stages
    assert stage.testable.tolist() == [True, False]
    assert stage.notes == ("r_1 never varied: untestable, its column is the declared graph's",)


@pytest.mark.parametrize(("broken", "decided"), [(0.2, True), (0.9, False)])
def test_steps_that_are_not_finite_are_left_out_and_counted(broken, decided):
    noise = np.random.default_rng(0)

    def rewards(previous, action, now):
        values = _rewards(previous, action, now)
        values[noise.random(len(values)) < broken] = np.nan
        return values

    graph = _graph(toy_task(rewards, 2))
    (stage,) = graph.stages
    assert stage.testable.any() == decided
    if decided:
        assert graph.env_steps > 1.15 * 5.2 * 200  # those that were left out count
        assert np.isfinite(stage.evidence["kl"]).all()
    else:
        assert "of 200 samples in 'random'" in stage.notes[0]
        assert "steps were not finite" in stage.notes[0]


def test_a_state_that_is_not_finite_ends_its_sequence():
    task, noise = toy_task(_rewards, 2), np.random.default_rng(0)

    def observe(facts):
        return np.where(noise.random((len(facts.eef_position), 1)) < 0.1, np.nan, task.observe(facts))

    (stage,) = _graph(dataclasses.replace(task, observe=observe)).stages
    assert stage.testable.all()
    assert np.isfinite(stage.evidence["kl"]).all()


def test_fewer_samples_than_asked_for_are_noted():
    calls = 0

    def rewards(previous, action, now):  # finite for the first half of what the first set may take, then never
        nonlocal calls
        calls += 1
        values = _rewards(previous, action, now)
        if 10 < calls <= 25:
            values[:] = np.nan
        return values

    (stage,) = _graph(toy_task(rewards, 2)).stages
    assert stage.notes == ("160 of 200 samples in 'random': 240 of 400 steps were not finite",)


def test_the_calibrated_cut_needs_no_simulator(collected):
    graph, folder = collected
    store = SampleFolder(folder)
    fdr = dataclasses.replace(TINY, options=KLSettings(max_epochs=1, select="fdr", fdr=0.3))
    found = discover_from_samples(TASK, store, store.origin()[0], fdr, 3, _quiet)
    for stage, same_fit in zip(found.stages, graph.stages, strict=True):
        np.testing.assert_array_equal(stage.evidence["kl"], same_fit.evidence["kl"])
        few = stage.evidence["q_value"] <= 0.3
        np.testing.assert_array_equal(stage.matrix[:, stage.testable], few[:, stage.testable])
