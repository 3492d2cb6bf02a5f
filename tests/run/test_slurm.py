"""`--executor slurm`: jobs of an array, queued again before their time limit, found again by the next command."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import fake_slurm
import pytest
from runs import results

from causalbench.errors import UserError
from causalbench.run.cell import Keeping
from causalbench.run.executors.slurm import Slurm
from causalbench.store.run_folder import RunFolder

HOOK = """
import os, signal, sys

def hook(event, arguments):
    # The time limit comes near as the first checkpoint of each kind of cell has been written, once.
    if event == "os.rename" and str(arguments[1]).endswith("checkpoint.safetensors"):
        flag = os.path.join(os.environ["FAKE_SLURM"], "signalled")
        try:
            os.close(os.open(flag, os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            return
        os.killpg(0, signal.SIGUSR2)

sys.addaudithook(hook)
"""


@pytest.fixture
def slurm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The state of a Slurm whose commands are on the path."""
    state, commands = tmp_path / "slurm", tmp_path / "bin"
    state.mkdir()
    commands.mkdir()
    for name in ("sbatch", "srun", "scontrol", "sacct", "scancel"):
        script = commands / name
        script.write_text(f"#!{sys.executable}\n" + Path(fake_slurm.__file__).read_text())
        script.chmod(0o755)
    monkeypatch.setenv("FAKE_SLURM", str(state))
    monkeypatch.setenv("PATH", f"{commands}{os.pathsep}{os.environ['PATH']}")
    return state


def test_an_unknown_option_is_named(slurm: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="--slurm partitoin=gpu"):
        Slurm(RunFolder(tmp_path / "run"), Keeping(), None, {"partitoin": "gpu"})


def test_a_machine_without_slurm_is_told_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UserError, match="no `sbatch` on the path"):
        Slurm(RunFolder(tmp_path / "run"), Keeping(), None, {})


@pytest.mark.long
def test_jobs_that_are_queued_again_end_with_the_bytes_of_an_uninterrupted_run(
    slurm: Path, finished_run: Path, tiny_suite: Path, command: list[str], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    (tmp_path / "sitecustomize.py").write_text(HOOK)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    out = tmp_path / "run"
    call = [*command, "run", str(tiny_suite), "--tier", "smoke", "--out", str(out), "--quiet"]
    call += ["--executor", "slurm", "--slurm", "time=60", "--checkpoint-every", "20"]
    done = subprocess.run(call, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert results(out) == results(finished_run)
    calls = (slurm / "calls.log").read_text()
    assert calls.count("sbatch") == 3, "the discovery, the learner without a graph, and then the one with it"
    assert calls.count("scontrol requeue") == 1
    logs = [path.read_text() for path in out.glob("cells/*/log.txt")]
    assert sum("continued from the checkpoint" in log for log in logs) == 1


@pytest.mark.long
def test_a_command_that_died_finds_its_jobs_again(
    slurm: Path, finished_run: Path, tiny_suite: Path, command: list[str], tmp_path: Path
) -> None:
    out = tmp_path / "run"
    call = [*command, "run", str(tiny_suite), "--tier", "smoke", "--out", str(out), "--quiet", "--executor", "slurm"]
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal, sys, time\n"
        "if '--executor' in sys.orig_argv:  # the command, not its jobs\n"
        "    time.sleep = lambda seconds: os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    died = subprocess.run(call, env=os.environ | {"PYTHONPATH": str(tmp_path)}, capture_output=True)
    assert died.returncode == -signal.SIGKILL, "it did not wait for its jobs"
    again = subprocess.run(call, capture_output=True, text=True)
    assert again.returncode == 0, again.stderr
    assert results(out) == results(finished_run)
    assert (slurm / "calls.log").read_text().count("sbatch") == 3, "a cell was queued twice"
