"""Environments by name, and what importing causalbench costs."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import tomllib
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import pytest

import causalbench
from causalbench.errors import UnknownNameError
from causalbench.plugins.environment_ids import GROUP, environment_ids, is_command
from causalbench.plugins.manager import installed

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
        # TorchRL, transformers and RLlib ask this.
        (
            "import causalbench, importlib.util; importlib.util.find_spec('gymnasium'); import gymnasium",
            "causalbench/PureManipulation-v0",
        ),
    ],
)
def test_gymnasium_knows_the_task_whichever_is_imported_first(imports: str, env_id: str) -> None:
    modules = modules_after(f"{imports}; gymnasium.make({env_id!r}, backend='kinematic')")
    assert "causalbench.core.staged.env" in modules
    assert modules.isdisjoint(HEAVY)


def test_the_ids_are_those_of_the_tasks() -> None:
    known = {task.env_id: task.name for task in installed().tasks.values()}
    assert environment_ids() == known
    assert known.keys() <= gymnasium.registry.keys()


@pytest.mark.parametrize("module", ["a_task/causalbench_hover.py", "a_gym_task/causalbench_mountain_car.py"])
def test_a_plugin_names_the_id_of_its_task(module: str) -> None:
    path = Path(__file__).parents[1] / "examples" / module
    project = tomllib.loads((path.with_name("pyproject.toml")).read_text())["project"]
    ((env_id, task),) = project["entry-points"][GROUP].items()
    assert f'    name="{task}",\n' in path.read_text()
    assert f'    env_id="{env_id}",\n' in path.read_text()


def test_an_id_that_gymnasium_refuses_stops_nothing(tmp_path: Path) -> None:
    info = tmp_path / "odd-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: odd\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{GROUP}]\nno id at all = odd\nodd/Odd-v0 = odd\n")
    code = "import causalbench, gymnasium; print('odd/Odd-v0' in gymnasium.registry)"
    env = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, [str(tmp_path), os.environ.get("PYTHONPATH")]))}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"
    assert done.stderr.startswith("environment id 'no id at all' of task 'odd': Malformed environment ID")


@pytest.mark.parametrize(
    ("argv", "orig_argv", "expected"),
    [
        (["/usr/bin/causalbench", "run"], ["python", "/usr/bin/causalbench", "run"], True),
        (["-m", "run"], ["python", "-m", "causalbench", "run"], True),
        (["-m"], ["python", "-m", "mine.causalbench_study"], False),
        (["train.py", "causalbench"], ["python", "train.py", "causalbench"], False),
        (["-c"], ["python", "-c", "import causalbench"], False),
        ([""], ["python"], False),
    ],
)
def test_only_the_command_leaves_registering_out(argv: list[str], orig_argv: list[str], expected: bool) -> None:
    assert is_command(argv, orig_argv) is expected


def make_by_id(link: Any, env_id: str) -> None:
    link.send(gymnasium.make(env_id).spec.kwargs["task"])


@pytest.mark.parametrize("method", ["spawn", pytest.param("forkserver", marks=pytest.mark.long), "fork"])
def test_an_id_that_names_the_module_works_in_any_process(method: str) -> None:
    context = multiprocessing.get_context(method)
    here, there = context.Pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a fork of a process with threads
        process = context.Process(target=make_by_id, args=(there, "causalbench:causalbench/PureManipulation-v0"))
        process.start()
    assert here.poll(60)
    assert here.recv() == "pure_manipulation"
    process.join()


def test_a_wrong_backend_is_named() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown backend \'kinmatic\'\. Did you mean 'kinematic'"):
        causalbench.make_env(backend="kinmatic")


def test_importing_causalbench_costs_little_more_than_gymnasium() -> None:
    assert modules_after("import causalbench").isdisjoint((*HEAVY, "numba", "pandas", "pluggy", "pydantic", "typer"))
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = causalbench.nonsense
