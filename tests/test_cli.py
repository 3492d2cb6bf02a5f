"""The command line: what it prints, its exit codes, and what it does not import."""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import pytest

from causalbench.cli.app import app
from causalbench.core.learners.methods import METHODS
from causalbench.plugins.manager import installed
from causalbench.store.statements import HYPOTHESES, add_statement
from causalbench.suite.hypotheses import Statement


@pytest.fixture
def call(command: list[str], tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """A function that runs the command with the given arguments in an empty folder."""

    def start(*arguments: str | Path, **env: str) -> subprocess.CompletedProcess[str]:
        full = [*command, *map(str, arguments)]
        return subprocess.run(full, capture_output=True, text=True, cwd=tmp_path, env=os.environ | env)

    return start


@pytest.mark.parametrize("arguments", [("--version",), ("--help",), ("run", "--help")], ids=" ".join)
def test_what_says_only_what_there_is_imports_nothing_heavy(arguments: tuple[str, ...]) -> None:
    """Gymnasium, and numpy with it, comes with causalbench itself, and pydantic with the ranges of typer's options."""
    code = (
        f"import sys; sys.argv = ['causalbench', *{arguments!r}]\n"
        "import atexit; atexit.register(lambda: print('MODULES', *sys.modules))\n"
        "from causalbench.cli.app import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    modules = done.stdout.partition("MODULES")[2].split()
    assert "causalbench" in modules
    heavy = {"torch", "numba", "scipy", "pandas", "matplotlib", "yaml", "stable_baselines3", "mo_gymnasium"}
    assert heavy.isdisjoint(modules)


def test_help_names_every_command(cli: Callable) -> None:
    shown = cli("--help").stdout
    for command in app.registered_commands:
        assert f" {command.callback.__name__.replace('_', '-')} " in shown


def test_the_version_is_one_line(call: Callable) -> None:
    done = call("--version")
    assert (done.returncode, done.stdout) == (0, f"causalbench {version('causalbench-robotics')}\n")


def test_a_mistake_in_the_suite_is_one_line_and_exit_code_2(call: Callable, tiny_suite: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.yaml"
    bad.write_text(tiny_suite.read_text().replace("mSAC]", "mmSAC]"))
    done = call("run", bad, "--tier", "smoke")
    assert (done.returncode, done.stdout) == (2, "")
    known = ", ".join(sorted(method.name for method in METHODS))
    assert done.stderr == (
        f"error: {bad}:5: methods.1: unknown method 'mmSAC'. Did you mean 'cmmSAC'? Known: {known}.\n"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--tier", "quick"], "error: unknown tier 'quick'. Known: smoke."),
        (["--tier", "smoke", "--out", "/proc/run"], "error: /proc/run: cannot be written ("),
        (["--tier", "smoke", "--only", "seed=4"], "error: unknown seed in --only '4'. Known: 0."),
        (["--tier", "smoke", "--executor", "serial", "--timeout", "1"], "error: --timeout needs --executor processes"),
        (["--tier", "smoke", "--executor", "serial", "--memory", "1"], "error: --memory needs --executor processes"),
        (["--tier", "smoke", "--ray-address", "auto"], "error: --ray-address needs --executor ray, this run has proc"),
        (["--tier", "smoke", "--slurm", "time=9"], "error: --slurm needs --executor slurm, this run has processes"),
    ],
)
def test_other_mistakes_of_run(cli: Callable, tiny_suite: Path, arguments: list[str], message: str) -> None:
    done = cli("run", tiny_suite, *arguments)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith(message)
    assert "Traceback" not in done.stderr


def test_a_run_with_a_smaller_budget_does_not_mix_into_a_folder(
    cli: Callable, tiny_suite: Path, finished_run: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other.yaml"
    other.write_text(tiny_suite.read_text().replace("env_steps: 120", "env_steps: 60"))
    done = cli("run", other, "--tier", "smoke", "--out", finished_run)
    assert done.returncode == 2
    assert "the budget on kinematic is {'env_steps': 60} and {'env_steps': 120}; use another --out" in done.stderr


def test_plan_estimates_from_what_has_run(cli: Callable, tiny_suite: Path, finished_run: Path) -> None:
    done = cli("plan", tiny_suite, "--tier", "smoke", "--seeds", "2", "--out", finished_run, "--json")
    cells = json.loads(done.stdout)["cells"]
    assert [(cell["kind"], cell["state"]) for cell in cells] == [
        ("discovery", "done"), ("learner", "done"), ("learner", "pending"), ("learner", "done"), ("learner", "pending"),
    ]  # fmt: skip
    seconds = [cell["seconds"] for cell in cells]
    assert (seconds[2], seconds[4]) == (pytest.approx(seconds[1]), pytest.approx(seconds[3]))
    table = cli("plan", tiny_suite, "--tier", "smoke", "--out", finished_run).stdout
    assert "About 0 s left" in table
    assert "No estimate for some cells" in cli("plan", tiny_suite, "--tier", "smoke").stdout


def test_leaderboard_prints_the_verdict_of_one_seed_plainly(cli: Callable, finished_run: Path) -> None:
    shown = cli("leaderboard", finished_run).stdout
    assert shown.count("1 seed cannot tell anything apart") == 1
    rows = json.loads(cli("leaderboard", finished_run, "--json").stdout)["leaderboard"]
    with (finished_run / "leaderboard.csv").open(newline="") as file:
        assert [row["method"] for row in csv.DictReader(file)] == [row["method"] for row in rows]
    empty = cli("leaderboard", finished_run / "cells")
    assert empty.returncode == 2
    assert "no cells here; give the folder that `causalbench run` wrote" in empty.stderr


def test_leaderboard_begins_with_the_verdicts_what_was_stated_before_first(
    cli: Callable, finished_run: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    shutil.copytree(finished_run, run)
    (run / HYPOTHESES).unlink()
    for hypothesis, before in (("cmSAC > mSAC", True), ("mSAC > cmSAC", False)):
        add_statement(run, Statement("tiny", "smoke", (hypothesis,), ("kinematic",), (0,)), before)
    lines = cli("leaderboard", run).stdout.splitlines()
    few = "So few seeds cannot decide anything: no p-value of theirs is below 1."
    assert lines[0].startswith("cmSAC > mSAC is not decided on kinematic: a difference of ")
    assert lines[1].startswith("Exploratory: mSAC > cmSAC is not decided on kinematic: a difference of ")
    assert lines[0].endswith(few)
    assert lines[1].endswith(few)
    assert lines[2].startswith("Leaderboard")
    verdicts = json.loads(cli("leaderboard", run, "--json").stdout)["verdicts"]
    assert [(row["stated"], row["measure"]) for row in verdicts] == [
        (1, "success_auc"), (0, "steps_to_90"), (0, "success_auc"), (0, "steps_to_90"),
    ]  # fmt: skip


def test_a_finished_run_again_does_nothing_and_prints_json(cli: Callable, tiny_suite: Path, finished_run: Path) -> None:
    done = cli("run", tiny_suite, "--tier", "smoke", "--out", finished_run, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    content = json.loads(done.stdout)
    assert [cell["state"] for cell in content["cells"]] == ["done"] * 3
    assert {row["method"] for row in content["leaderboard"]} == {"cmSAC", "mSAC"}


def test_names_lists_all_that_a_suite_may_name(cli: Callable) -> None:
    found = json.loads(cli("names", "--json").stdout)
    plugins = installed()
    for kind in ("task", "method", "learner", "discoverer"):
        assert {row["name"] for row in found if row["kind"] == kind} == getattr(plugins, f"{kind}s").keys()
    rows = {row["name"]: row for row in found}
    assert rows["cmSAC-kl"]["about"] == "SAC, causal actions, factored gradient, matrix: discovered; discoverer: kl"
    assert rows["stack_cubes"]["package"] == "causalbench_robosuite"
    assert "cmSAC-kl" in cli("names").stdout


def test_backends_lists_a_broken_plugin_with_its_error(call: Callable, install: Callable[[str, str], Path]) -> None:
    site = install("causalbench-broken", "import a_simulator_that_is_not_here")
    path = os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")]).strip(os.pathsep)
    done = call("backends", PYTHONPATH=path)
    assert done.returncode == 0
    lines = done.stdout.splitlines()
    rows = [[cell.strip() for cell in line.strip("│").split("│")] for line in lines if "│ kinematic" in line]
    own = ("causalbench-robotics", version("causalbench-robotics"))
    assert rows == [
        ["kinematic", options, "numpy, not physics", "floating hand", *own, capabilities, "none", "ok"]
        for options, capabilities in (
            ("", "exact_restore, rgb, several_objects"),
            ("mobile=true", "exact_restore, lidar, mobile_base, rgb, several_objects"),
        )
    ]
    broken = next(line for line in done.stdout.splitlines() if "causalbench-broken" in line)
    assert "ModuleNotFoundError: No module named 'a_simulator_that_is_not_here'" in broken


def test_discover_refuses_what_does_not_exist(cli: Callable) -> None:
    done = cli("discover", "--preset", "papr")
    assert (done.returncode, done.stderr) == (
        2,
        "error: --preset: should be 'quick', 'paper' or 'paper_large', got 'papr'. Did you mean 'paper'?\n",
    )
    done = cli("discover", "--backend", "gymrobot9")
    assert (done.returncode, done.stderr.startswith("error: --backend: unknown backend 'gymrobot9'.")) == (2, True)


NET = """
import sys
from causalbench.cli import app
def broken():
    raise {error}
app.app.command("broken")(broken)
sys.argv = ["causalbench", "broken"]
app.main()
"""


@pytest.mark.parametrize(
    ("error", "code", "sentence"),
    [
        ("ZeroDivisionError('no \\x1b[2J way')", 3, r"unexpected ZeroDivisionError: no \x1b[2J way"),
        ("OSError(28, 'No space left on device', 'results.csv')", 1, "failed: results.csv: No space left on device"),
    ],
)
def test_whatever_happens_is_a_sentence(error: str, code: int, sentence: str, tmp_path: Path) -> None:
    script, env = [sys.executable, "-c", NET.format(error=error)], os.environ | {"TMPDIR": str(tmp_path)}
    done = subprocess.run(script, capture_output=True, text=True, env=env)
    assert done.returncode == code
    assert done.stderr.splitlines()[0] == sentence
    assert "Traceback" not in done.stderr
    if code == 3:
        (report,) = tmp_path.glob("causalbench-*.txt")
        assert str(report) in done.stderr
        assert "in broken" in report.read_text()
    raised = subprocess.run(script, capture_output=True, text=True, env=env | {"CAUSALBENCH_TRACEBACK": "1"})
    assert "Traceback" in raised.stderr
