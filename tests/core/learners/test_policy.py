"""A saved policy is what was saved, or refused in a sentence."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from causalbench.core.learners.policy import ObservationScale, StagedPolicy, load_policy
from causalbench.errors import InvalidObservationError, UserError


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


@pytest.fixture(scope="module")
def two() -> tuple[StagedPolicy, dict[str, Any]]:
    """A policy of two stages that observes three numbers and the gripper, and two observations for it."""
    rng = np.random.default_rng(0)
    sizes = (4, 5), (5,), (5, 4), (4,)
    weights = [torch.from_numpy(rng.normal(size=size).astype(np.float32)) for size in sizes]
    scale = ObservationScale((-1.0,) * 3 + (0.0,), (1.0,) * 3 + (0.1,))
    policy = StagedPolicy([weights] * 2, [np.arange(2)] * 2, 2, scale)
    state, gripper = rng.uniform(-1, 1, (2, 3)), rng.uniform(0, 0.1, (2, 1))
    return policy, {"state": state, "gripper": gripper, "stage": np.array([0, 1])}


def test_predict_takes_numbers_of_other_types_as_those_of_environments(two: Any) -> None:
    policy, given = two
    expected = policy.predict({k: v.astype(np.float32) if k != "stage" else v for k, v in given.items()})[0]
    for same in (given, {key: value.tolist() for key, value in given.items()}):
        assert policy.predict(same)[0].tolist() == expected.tolist()
    one = {key: value[1] for key, value in given.items()}
    for same in (one, {key: np.asarray(value).tolist() for key, value in one.items()}):
        assert policy.predict(same)[0].tolist() == expected[1].tolist()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"state": np.full((2, 3), np.nan)}, r"observation\['state'\] is not finite"),
        ({"gripper": np.full((2, 1), np.inf)}, r"observation\['gripper'\] is not finite"),
        ({"state": np.zeros((2, 5))}, r"observation\['state'\] has shape \(2, 5\), expected 2 rows of 4 numbers"),
        ({"gripper": np.zeros((1, 1))}, r"observation\['gripper'\] has shape \(1, 1\), expected 2 rows of 1 numbers"),
        ({"state": "abc"}, r"observation\['state'\] is no array of numbers"),
        ({"state": [[1, 2, 3], [1, 2]]}, r"observation\['state'\] is no array of numbers"),
        ({"state": np.float32(1)}, r"observation\['state'\] has shape \(\)"),
        ({"stage": np.array([0, 2])}, r"observation\['stage'\] is array\(\[0, 2\]\), expected 0 to 1"),
        ({"stage": np.array([-1, 0])}, "expected 0 to 1"),
        ({"stage": np.array([0])}, "expected 2 whole numbers"),
        ({"stage": np.array([0.0, 1.0])}, "expected 2 whole numbers"),
        ({"stage": np.array([True, False])}, "expected 2 whole numbers"),
        ({"stage": None}, "expected 2 whole numbers"),
    ],
)
def test_predict_refuses_what_no_environment_returns(two: Any, change: dict[str, Any], message: str) -> None:
    policy, given = two
    with pytest.raises(InvalidObservationError, match=message):
        policy.predict({**given, **change})


def test_predict_names_what_is_missing(two: Any) -> None:
    policy, given = two
    with pytest.raises(InvalidObservationError, match=r"this policy reads \['stage'\], and the observation has"):
        policy.predict({key: value for key, value in given.items() if key != "stage"})
    with pytest.raises(InvalidObservationError, match="expected a dictionary, got ndarray"):
        policy.predict(given["state"])
