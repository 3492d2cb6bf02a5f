"""Kept samples are those that were collected, or are collected again."""

from __future__ import annotations

import json
import random
from pathlib import Path

import numpy as np
import pytest

from causalbench.core.discovery.samples.transitions import Samples
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.store.samples import SampleFolder

ABOUT = {"stage": 1, "set": "random", "seed": 0}


@pytest.fixture
def kept(tmp_path: Path) -> tuple[SampleFolder, Samples]:
    rng, n = np.random.default_rng(0), 6
    n_terms = len(TASK.stage_terms(1, discoverable_only=True))
    sizes = (len(TASK.state_names) + 1, len(TASK.actions), n_terms)
    states, actions, rewards = (rng.normal(size=(n, size)).astype(np.float32) for size in sizes)
    frames = (rng.integers(0, 255, (n, 12), dtype=np.uint8),)
    samples = Samples(states, actions, rewards, np.zeros(n, np.int32), n, sensor="rgb", frames=frames)
    folder = SampleFolder(tmp_path / "data")
    folder.save(ABOUT, samples, TASK)
    return folder, samples


def test_samples_come_back_bit_for_bit(kept: tuple[SampleFolder, Samples]) -> None:
    folder, samples = kept
    found = folder.load(ABOUT)
    assert found is not None
    assert found.digest() == samples.digest()
    assert folder.load(ABOUT | {"seed": 1}) is None
    assert folder.load(ABOUT | {"stage": 2}) is None


def test_numpy_reads_them_alone(kept: tuple[SampleFolder, Samples]) -> None:
    folder, samples = kept
    with np.load(folder.path / "stage1-random.npz", allow_pickle=False) as file:
        assert np.array_equal(file["states"], samples.states)
        assert json.loads(str(file["about"]))["request"] == ABOUT


def test_no_flipped_bit_and_no_cut_goes_unnoticed(
    kept: tuple[SampleFolder, Samples], caplog: pytest.LogCaptureFixture
) -> None:
    folder, _ = kept
    path, rng = folder.path / "stage1-random.npz", random.Random(5)
    content = path.read_bytes()
    for _ in range(1000):
        changed = bytearray(content)
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
        path.write_bytes(bytes(changed))
        assert folder.load(ABOUT) is None
    for size in (0, 1, 64, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:size])
        assert folder.load(ABOUT) is None
    assert f"{path}: its SHA-256 is not that of the samples that were written; its samples are collected" in caplog.text


def test_a_file_that_another_program_saved_is_no_kept_set(kept: tuple[SampleFolder, Samples]) -> None:
    folder, _ = kept
    path = folder.path / "stage1-random.npz"
    with np.load(path, allow_pickle=False) as file:
        arrays = dict(file)
    np.savez(path, **arrays)
    assert folder.load(ABOUT) is None
