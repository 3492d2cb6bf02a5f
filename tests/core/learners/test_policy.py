"""A saved policy is what was saved, or refused in a sentence."""

from __future__ import annotations

import json
import random
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from causalbench.core.learners.policy import ObservationScale, StagedPolicy, load_policy
from causalbench.errors import UserError


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    actor = [torch.randn(3, 4), torch.randn(4), torch.randn(4, 4), torch.randn(4)]
    scale = ObservationScale((-1.0, -2.0, 0.0), (1.0, 2.0, 0.1))
    StagedPolicy([actor], [np.array([0, 2])], 3, scale).save(tmp_path / "policy")
    return tmp_path / "policy"


def test_what_was_saved_acts_alike(saved: Path) -> None:
    state, gripper = np.array([0.3, -0.7], np.float32), np.array([0.05], np.float32)
    observation = {"state": state, "gripper": gripper, "stage": np.array(0)}
    first, second = (load_policy(saved).predict(observation)[0] for _ in range(2))
    assert np.array_equal(first, second)
    assert first[1] == 0
    assert first[0] != 0


@pytest.mark.parametrize("name", ["policy.json", "policy.safetensors"])
def test_no_flipped_bit_goes_unnoticed(saved: Path, name: str) -> None:
    rng, before, meta = random.Random(2), load_policy(saved), json.loads((saved / "policy.json").read_text())
    content, equal = (saved / name).read_bytes(), 0
    for _ in range(1000):
        changed = bytearray(content)
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
        (saved / name).write_bytes(bytes(changed))
        if _same(bytes(changed), name, meta):  # a blank of the JSON became another
            equal += 1
            assert load_policy(saved).scale == before.scale
        else:
            with pytest.raises(UserError, match=f"^{saved}: "):
                load_policy(saved)
    assert equal < 20


def _same(content: bytes, name: str, meta: object) -> bool:
    try:
        return name == "policy.json" and json.loads(content) == meta
    except ValueError:
        return False


def test_weights_of_another_policy_are_refused(saved: Path) -> None:
    """Files that are whole, each for itself."""
    weights = load_file(saved / "policy.safetensors")
    save_file({name: 2 * tensor for name, tensor in weights.items()}, saved / "policy.safetensors")
    with pytest.raises(UserError, match=r"the SHA-256 of policy.safetensors differs\); train again"):
        load_policy(saved)


def test_no_policy_is_said(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"no trained policy here \(.*policy.json is missing\)"):
        load_policy(tmp_path)
