"""Discovery's samples and reward models see a task's features, unless its settings leave them out."""

from __future__ import annotations

import dataclasses
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scenes import discover

from causalbench.core.discovery.methods.kl.settings import KLSettings
from causalbench.core.discovery.reward_model.models import model_inputs
from causalbench.core.discovery.samples.transitions import Samples
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.kinematic import make
from causalbench.core.tasks.mobile_manipulation import TASK as MOBILE
from causalbench.core.tasks.pure_manipulation import TASK as PURE
from causalbench.run.from_samples import discover_from_folder
from causalbench.store.samples import SampleFolder

SETTINGS = DiscoverySettings(training_count=24, n_placebos=0, options=KLSettings(max_epochs=1, batch_size=16))


def columns(path: Path) -> dict[str, np.ndarray]:
    """The arrays of the samples of stage 1."""
    with np.load(path / "stage1-random.npz", allow_pickle=False) as file:
        return {name: file[name] for name in ("states", "state_names", "actions", "rewards", "sequence")}


@pytest.mark.parametrize("task", [PURE, MOBILE], ids=lambda task: task.name)
def test_they_are_columns_of_the_states_and_change_nothing_else(task, tmp_path: Path) -> None:
    found = {}
    for on in (True, False):
        settings, store = dataclasses.replace(SETTINGS, features=on), SampleFolder(tmp_path / str(on))
        discover(task, partial(make, mobile=task is MOBILE), settings, 0, lambda share, text: None, store=store)
        found[on] = columns(store.path)
    names = (*task.state_names, "gripper_opening")
    assert tuple(found[True]["state_names"]) == (*names, *task.feature_names)
    assert tuple(found[False]["state_names"]) == names
    states, bare = found[True].pop("states"), found[False].pop("states")
    np.testing.assert_array_equal(states[:, : len(names)], bare)
    np.testing.assert_array_equal(states[:, len(names) :], task.features_of(bare[:, :-1]))
    for name in ("actions", "rewards", "sequence"):
        np.testing.assert_array_equal(found[True][name], found[False][name])


def test_reward_models_read_every_column_of_the_states() -> None:
    ones = np.ones((5, 3), dtype=np.float32)
    samples = Samples(7 * ones, ones[:, :2], ones[:, :1], np.arange(5, dtype=np.int32), 5)
    assert model_inputs(samples).tolist() == [[7, 7, 7, 1, 1]] * 5


@pytest.mark.parametrize("on", [True, False])
def test_samples_say_whether_they_have_them(on: bool, tmp_path: Path) -> None:
    """A discovery from files takes them as they are, whatever its defaults."""
    settings, store = dataclasses.replace(SETTINGS, features=on), SampleFolder(tmp_path / "data")
    graph = discover(PURE, make, settings, 0, lambda share, text: None, store=store)
    section = {"discoverer": "kl", "kl": {"max_epochs": 1, "batch_size": 16}}
    again = discover_from_folder(tmp_path / "data", section, tmp_path / "again")
    assert again.hash == graph.hash
    assert again.provenance["settings"]["features"] is on
