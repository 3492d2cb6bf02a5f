"""`causalbench run` as a whole, through the command: results, continuing, kills at any move."""

from __future__ import annotations

import csv
import functools
import hashlib
import json
import os
import random
import re
import shutil
import signal
import subprocess
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import backend_option
import pytest
from kills import call_until
from runs import RESULT_FILES, results

from causalbench import formats
from causalbench.plugins.manager import installed
from causalbench.run.cell import Keeping, run_cell
from causalbench.store.run_folder import RunFolder
from causalbench.suite.cells import LearnerCell
from causalbench.suite.plan import make_plan
from causalbench.suite.schema import load_suite

SIMULATORS = [name for name in backend_option.names() if name != "kinematic"]


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def states(run: Path) -> dict[str, str]:
    return {path.parent.name: json.loads(path.read_text())["state"] for path in run.glob("*/*/status.json")}


def arguments(suite: Path, out: Path) -> list[str]:
    return ["run", str(suite), "--tier", "smoke", "--out", str(out), "--jobs", "2", "--quiet"]


def kept_often(command: list[str], suite: Path, out: Path) -> list[str]:
    """The command whose learners keep a checkpoint every few steps."""
    return [*command, *arguments(suite, out), "--checkpoint-every", "20"]


def test_a_finished_run_has_every_file_of_the_layout(finished_run: Path) -> None:
    top = {path.name for path in finished_run.iterdir() if not path.name.startswith(".")}
    records = {*RESULT_FILES, "timing.csv", "environment.json", "run.json", "suite.yaml", "cells", "discovery"}
    assert top == records | {"report.html"}
    learner = {"cell.json", "status.json", "progress.csv", "episodes.csv", "counts.json", "log.txt", "policy"}
    learner.add("checkpoint.safetensors")
    assert [{p.name for p in cell.iterdir()} for cell in (finished_run / "cells").iterdir()] == [learner] * 2
    discovery = {"cell.json", "status.json", "graph.json", "manual.json", "evidence.csv", "log.txt", "figures", "data"}
    discovery |= {"oracle.csv", "score.csv"}
    assert [{p.name for p in cell.iterdir()} for cell in (finished_run / "discovery").iterdir()] == [discovery]


@pytest.mark.parametrize("backend", backend_option.quick(SIMULATORS))
def test_a_tiny_suite_runs_on_a_simulator(
    backend: str, finished_run: Path, tiny_suite: Path, command: list[str], tmp_path: Path
) -> None:
    suite = tmp_path / "tiny.yaml"
    suite.write_text(tiny_suite.read_text().replace("[kinematic]", f"[{backend}]"))
    done = subprocess.run([*command, *arguments(suite, tmp_path / "run")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = rows(tmp_path / "run" / "results.csv")
    assert sorted((row["backend"], row["method"]) for row in found) == [(backend, "cmSAC"), (backend, "mSAC")]
    # The learner used the graph that was discovered here, which is not that of another backend.
    graph = json.loads(next(tmp_path.glob("run/discovery/*/graph.json")).read_text())["hash"]
    assert {row["graph"] for row in found if row["method"] == "cmSAC"} == {graph}
    assert graph not in {row["graph"] for row in rows(finished_run / "results.csv")}


@pytest.mark.long
def test_the_sac_family_runs_on_mobile_manipulation_by_naming_it(
    tiny_suite: Path, cli: Callable, tmp_path: Path
) -> None:
    suite = tmp_path / "tiny.yaml"
    text = tiny_suite.read_text().replace("pure_manipulation", "mobile_manipulation")
    suite.write_text(text.replace("cmSAC, mSAC", "cmSAC, cSAC"))
    done = cli(*arguments(suite, tmp_path / "run"), "--executor", "serial")
    assert done.returncode == 0, done.stdout
    assert {row["method"] for row in rows(tmp_path / "run" / "results.csv")} == {"cmSAC", "cSAC"}


def test_results_have_the_columns_of_the_contract_and_agree_with_the_curves(finished_run: Path) -> None:
    header = (finished_run / "results.csv").read_text().splitlines()[0]
    assert header == (
        "task,backend,method,grid_point,seed,budget,success_auc,steps_to_90,stopped_at,env_steps,discovery_env_steps,episodes,"
        "success_deterministic,success_sampled,"
        "success_low,success_high,best_success,held_rate,mean_final_stage,reversals_per_episode,"
        "reversals_per_1000_steps,mean_return,graph,source"
    )
    found = rows(finished_run / "results.csv")
    assert [(row["method"], row["seed"], row["env_steps"]) for row in found] == [
        ("cmSAC", "0", "120"),
        ("mSAC", "0", "120"),
    ]
    graph = json.loads(next(finished_run.glob("discovery/*/graph.json")).read_text())
    assert [row["graph"] for row in found] == [graph["hash"], ""]
    assert [row["discovery_env_steps"] for row in found] == [str(graph["env_steps"]), "0"]
    curves = rows(finished_run / "curves.csv")
    assert {row["env_steps"] for row in curves} == {"60", "120"}
    assert [row["mean_final_stage"] for row in curves if row["env_steps"] == "120"] == [
        r["mean_final_stage"] for r in found
    ]


def test_transitions_of_training_add_up_to_the_budget(finished_run: Path) -> None:
    moves = [row for row in rows(finished_run / "stages.csv") if row["quantity"] == "transitions"]
    for method in ("cmSAC", "mSAC"):
        assert sum(int(row["count"]) for row in moves if row["method"] == method) == 120


def test_discovery_rows_have_the_oracles_effects_and_the_graph_its_score(finished_run: Path) -> None:
    graph = json.loads(next(finished_run.glob("discovery/*/graph.json")).read_text())
    truth = rows(next(finished_run.glob("discovery/*/oracle.csv")))
    keys, said = ("stage", "term", "action"), ("effect", "effect_low", "effect_high", "grade")
    beside = [
        [*(row[k] for k in keys), *(row[f"oracle_{s}"] for s in said)] for row in rows(finished_run / "discovery.csv")
    ]
    assert beside == [[row[name] for name in (*keys, *said)] for row in truth]
    assert {row["grade"] for row in truth} <= {"absent", "weak", "strong", "untestable"}
    score = rows(next(finished_run.glob("discovery/*/score.csv")))
    assert [row["stage"] for row in score] == ["1", "2", "3", "4", "all"]
    assert [{k: str(v) for k, v in row.items()} for row in graph["oracle"]["scores"]] == score
    # Nine steps a state (seven actions, the step itself and its repetition), which are no part of discovery's own.
    assert graph["oracle"]["env_steps"] == 4 * 3 * 9
    assert graph["env_steps"] == 4 * (8 * 32 + 16)  # sets of 20 and of 4 samples, 16 worlds at a time
    assert graph["oracle"]["exact_restore"] is True
    assert all(value in (0, None) for stage in graph["oracle"]["floor"].values() for value in stage.values())


def test_discovery_rows_are_the_graph(finished_run: Path) -> None:
    graph = json.loads(next(finished_run.glob("discovery/*/graph.json")).read_text())
    found = rows(finished_run / "discovery.csv")
    for stage in graph["stages"]:
        here = [row for row in found if row["stage"] == str(stage["stage"])]
        expected = [[int(x) for x in column] for column in zip(*stage["matrix"], strict=True)]
        width = len(stage["actions"])
        selected = [int(row["selected"]) for row in here]
        assert [selected[i : i + width] for i in range(0, len(selected), width)] == expected
        assert [row["action"] for row in here] == stage["actions"] * len(stage["terms"])


def test_the_serial_executor_gives_the_same_bytes(
    finished_run: Path, tiny_suite: Path, cli: Callable, tmp_path: Path
) -> None:
    assert cli(*arguments(tiny_suite, tmp_path / "run"), "--executor", "serial").returncode == 0
    assert results(tmp_path / "run") == results(finished_run)


def test_a_second_command_runs_only_what_is_missing_or_failed(
    finished_run: Path, tiny_suite: Path, cli: Callable, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    shutil.copytree(finished_run, run)
    kept, again = sorted((run / "cells").iterdir())
    (again / "status.json").write_text(json.dumps({"schema": formats.CELL, "state": "failed", "reason": "x"}))
    before = (kept / "status.json").stat().st_mtime_ns
    done = cli(*arguments(tiny_suite, run)[:-1], "--executor", "serial")
    assert done.returncode == 0
    assert "1 of 3 cells to run" in done.stderr
    assert (kept / "status.json").stat().st_mtime_ns == before
    assert results(run) == results(finished_run)


@pytest.mark.parametrize("how", [pytest.param(signal.SIGINT, marks=pytest.mark.long), signal.SIGTERM])
def test_a_stop_writes_checkpoints_and_leaves_no_failed_cell_and_no_process(
    how: signal.Signals, tiny_suite: Path, command: list[str], tmp_path: Path
) -> None:
    """Ctrl-C reaches the whole group, a scheduler's SIGTERM at least the command."""
    suite, out = tmp_path / "long.yaml", tmp_path / "run"
    text = tiny_suite.read_text().replace("env_steps: 120", "env_steps: 20_000").replace("every: 60", "every: 20_000")
    suite.write_text(text.replace("learning_starts: 20", "learning_starts: 19_000"))
    with subprocess.Popen(
        [*command, *arguments(suite, out)[:-1], "--checkpoint-every", "20000", "--only", "method=mSAC"],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background jobs ignore it
    ) as process:  # fmt: skip
        assert process.stderr is not None
        next(line for line in process.stderr if "SAC on kinematic" in line)  # a learner is at work
        if how == signal.SIGINT:
            os.killpg(process.pid, how)
        else:
            process.send_signal(how)
        rest = process.stderr.read()  # ends when nothing holds the pipe any more: parent, fork server and cells
        assert process.wait() == 130
    assert "stopped; the same command continues with what is missing" in rest
    assert "Traceback" not in rest
    assert set(states(out).values()) <= {"done", "running", "pending"}
    (log, *_) = [text for path in out.glob("cells/*/log.txt") if "stopped at env step" in (text := path.read_text())]
    assert "its checkpoint is" in log
    assert any(out.glob("cells/*/checkpoint*")), "no learner kept where it was"


def kill_at_moves(
    n: int, seed: int, whole: Path, moves: int, call: Callable[[Path], list[str]], folder: Path,
    discovered: bool = False,
) -> Counter[tuple[str, str]]:  # fmt: skip
    """Kill a command at `n` random moves (see `kills`); what it then ends with must be the files of `whole`.

    `call` has the command for a folder, and `moves` is how many it makes without a kill; with `discovered` the causal
    graphs are there already, so that kills hit learners. Returns how often the cell of each backend and method
    continued from a checkpoint; `kills.log` in `folder` has what was done.
    """
    rng = random.Random(seed)
    kills, attempt = 0, 0
    continued: Counter[tuple[str, str]] = Counter()

    def note(line: str) -> None:
        with (folder / "kills.log").open("a") as file:
            file.write(line + "\n")

    while kills < n:
        out = folder / f"run{attempt}"
        attempt += 1
        if discovered:
            copy_discoveries(whole, out)
        code = -signal.SIGKILL
        while code:
            last, writer_too = (1 + int(moves * rng.random()), rng.random() < 0.5) if kills < n else (0, False)
            code, _ = call_until(call(out), folder, last, writer_too)
            assert code in (0, -signal.SIGKILL if last else 0)
            if code:
                kills += 1
                note(f"{out.name}: kill {kills} at move {last}, {dict(Counter(states(out).values()))}")
            check_whole(out)
        assert results(out) == results(whole)
        assert set(states(out).values()) == {"done"}
        note(f"{out.name}: same bytes")
        continued += continuations(out, note)
    return continued


def copy_discoveries(run: Path, out: Path) -> None:
    """Begin `out` with the causal graphs of `run`, and with what was stated before they were discovered."""
    shutil.copytree(run / "discovery", out / "discovery")
    shutil.copy(run / "hypotheses.json", out)


def continuations(run: Path, note: Callable[[str], None]) -> Counter[tuple[str, str]]:
    """(backend, method) -> how often its cells continued from a checkpoint."""
    found: Counter[tuple[str, str]] = Counter()
    for path in sorted(run.glob("cells/*/log.txt")):
        steps = [line.rpartition(" ")[2] for line in path.read_text().splitlines() if "continued from" in line]
        if steps:
            cell = json.loads((path.parent / "cell.json").read_text())
            backend, method = cell["backend"]["name"], cell["method"]["name"]
            found[backend, method] += len(steps)
            note(f"  {backend} {method} continued at env steps {', '.join(steps)}")
    return found


def check_whole(out: Path) -> None:
    """Every cell that says it is done has all its files, and none has failed."""
    for name, state in states(out).items():
        assert state in ("done", "running"), name
        if state == "done" and (cell := out / "cells" / name).exists():
            assert {"progress.csv", "counts.json", "policy"} <= {path.name for path in cell.iterdir()}


def test_kill_9_at_two_moves(
    counted_run: tuple[Path, int], tiny_suite: Path, command: list[str], tmp_path: Path
) -> None:
    kill_at_moves(2, 166, *counted_run, functools.partial(kept_often, command, tiny_suite), tmp_path)


LEARNERS = ("cmSAC", "cmmSAC", "mSAC", "cSAC", "cmPPO", "cmmPPO", "mPPO")


@pytest.mark.long
@pytest.mark.parametrize("backend", ["kinematic", "gymrob", "pybullet"])
def test_kill_9_at_twenty_moves_of_every_learner(
    backend: str, tiny_suite: Path, command: list[str], tmp_path: Path
) -> None:
    """stable-baselines3's keep no checkpoints."""
    suite = tmp_path / "tiny.yaml"
    text = tiny_suite.read_text().replace("env_steps: 120", "env_steps: 300").replace("every: 60", "every: 150")
    text = text.replace("[kinematic]", f"[{backend}]").replace("cmSAC, mSAC", ", ".join(LEARNERS))
    suite.write_text(text.replace("learning_starts: 20,", "learning_starts: 20, PPO: {n_steps: 48},"))
    whole, trained = tmp_path / "whole", tmp_path / "trained"
    subprocess.run([*command, *arguments(suite, whole)], check=True, capture_output=True)
    copy_discoveries(whole, trained)
    code, moves = call_until(kept_often(command, suite, trained), tmp_path)
    assert code == 0
    assert results(trained) == results(whole)
    call = functools.partial(kept_often, command, suite)
    continued = kill_at_moves(20, 20_240, whole, moves, call, tmp_path, discovered=True)
    assert sum(continued.values()) >= 5


def _rewritten(change: Callable[[dict[str, Any]], object]) -> Callable[[str], str]:
    """A change of a graph whose hash is right again afterwards, as of a graph for another task."""

    def rewrite(text: str) -> str:
        content = json.loads(text)
        change(content)
        del content["hash"]
        canonical = json.dumps(content, sort_keys=True)
        return json.dumps(content | {"hash": hashlib.sha256(canonical.encode()).hexdigest()[:16]})

    return rewrite


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda text: text.replace('"env_steps": ', '"env_steps": 1'), "differs from the recorded"),
        (_rewritten(lambda g: g["stages"][1]["actions"].reverse()), "stage 2: actions or terms differ from the task's"),
        (_rewritten(lambda g: g["stages"][2].update(matrix=[[False] * 2] * 7)), "stage 3: no action causes any reward"),
    ],
    ids=["hash", "action names", "empty action set"],
)
def test_a_graph_that_does_not_fit_ends_the_cell_with_a_sentence(
    edit: Callable[[str], str], message: str, finished_run: Path, tiny_suite: Path, tmp_path: Path
) -> None:
    run = RunFolder(tmp_path / "run")
    shutil.copytree(finished_run, run.path)
    plan = make_plan(load_suite(tiny_suite, installed()), "smoke", installed())
    cell = next(cell for cell in plan.cells if isinstance(cell, LearnerCell) and cell.method.name == "cmSAC")
    path, found = run.folder(cell.discovery) / "graph.json", run.status(cell.discovery)
    path.write_text(edit(path.read_text()))
    run.finish(cell.discovery, found)  # the file is what was written, as its digest says; what it says does not fit
    run.start(cell)
    status = run_cell(cell, run, lambda progress: None, Keeping())
    assert status.state == "failed"
    assert message in status.reason
    assert "Traceback" not in status.reason


def test_exploding_losses_end_the_cell_as_diverged_with_its_last_good_checkpoint(
    tiny_suite: Path, cli: Callable, tmp_path: Path
) -> None:
    suite = tmp_path / "tiny.yaml"
    suite.write_text(tiny_suite.read_text().replace("learning_starts: 20", "learning_starts: 70, learning_rate: 1e30"))
    more = ("--only", "method=mSAC", "--checkpoint-every", "20", "--executor", "serial")
    assert cli(*arguments(suite, tmp_path / "run"), *more).returncode == 1
    status = json.loads(next(tmp_path.glob("run/cells/*/status.json")).read_text())
    kept = next(tmp_path.glob("run/cells/*/checkpoint.safetensors"))
    assert status["state"] == "diverged"
    assert re.fullmatch(
        r"env step \d+, stage 1: .* after \d+ updates; last good checkpoint, of step 100: (.*)", status["reason"]
    ).group(1) == str(kept)
