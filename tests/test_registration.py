"""Environments by name, and what importing causalbench costs."""

from __future__ import annotations

import subprocess
import sys

import gymnasium
import pytest

import causalbench
from causalbench.errors import UnknownNameError

HEAVY = ("torch", "stable_baselines3", "mujoco", "gymnasium_robotics")


def modules_after(statement: str) -> set[str]:
    code = f"import sys; {statement}; print(*sys.modules)"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


def test_gymnasium_makes_the_task_in_a_named_backend() -> None:
    env = gymnasium.make("causalbench/PureManipulation-v0", backend="kinematic", observe_gripper=False)
    obs, info = env.reset(seed=3)
    assert set(obs) == {"state", "features", "stage"}
    assert env.unwrapped.worlds.scene.spec.backend == "kinematic"
    same, _ = causalbench.make_env(backend="kinematic", observe_gripper=False).reset(seed=3)
    assert obs["state"].tolist() == same["state"].tolist()
    assert info == {"stage": 1}


@pytest.mark.parametrize(
    ("imports", "env_id"),
    [
        ("import causalbench, gymnasium", "causalbench/PureManipulation-v0"),
        ("import gymnasium, causalbench", "causalbench/PureManipulation-v0"),
        ("import gymnasium", "causalbench:causalbench/PureManipulation-v0"),
    ],
)
def test_gymnasium_knows_the_task_whichever_is_imported_first(imports: str, env_id: str) -> None:
    modules = modules_after(f"{imports}; gymnasium.make({env_id!r}, backend='kinematic')")
    assert "causalbench.core.staged.env" in modules
    assert modules.isdisjoint(HEAVY)


def test_a_wrong_backend_is_named() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown backend \'kinmatic\'\. Did you mean 'kinematic'"):
        causalbench.make_env(backend="kinmatic")


def test_importing_causalbench_costs_nothing() -> None:
    assert modules_after("import causalbench").isdisjoint((*HEAVY, "gymnasium", "numpy", "pandas", "pluggy"))
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = causalbench.nonsense
