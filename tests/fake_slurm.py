"""Slurm's commands for tests: jobs start at once, each in a process group of its own, as the tasks of a step are.

Installed under the commands' names; `FAKE_SLURM` is the folder with its state: `ID.json` for each job and `calls.log`.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

STATE = Path(os.environ.get("FAKE_SLURM", ""))


def launch(name: str, script: str) -> None:
    array, _, task = name.partition("_")
    environment = os.environ | {"SLURM_JOB_ID": name, "SLURM_JOB_NUM_NODES": "1", "SLURM_NTASKS": "1"}
    if task:
        environment |= {"SLURM_ARRAY_JOB_ID": array, "SLURM_ARRAY_TASK_ID": task}
    log = (STATE / "jobs.log").open("a")
    child = subprocess.Popen(["bash", script], env=environment, start_new_session=True, stdout=log, stderr=log)
    (STATE / f"{name}.json").write_text(json.dumps({"script": script, "pid": child.pid}))


def sbatch(script: str) -> None:
    text = Path(script).read_text()
    kept = STATE / Path(script).name
    kept.write_text(text)  # submitit moves its own
    number = str(1 + len(list(STATE.glob("*.sh"))))
    found = re.search(r"--array=0-(\d+)", text)
    for name in [f"{number}_{task}" for task in range(int(found[1]) + 1)] if found else [number]:
        launch(name, str(kept))
    sys.stdout.write(f"Submitted batch job {number}\n")


def srun(*arguments: str) -> None:
    command = list(arguments[1:])  # without --unbuffered
    names = {"%A": os.environ.get("SLURM_ARRAY_JOB_ID", ""), "%a": os.environ.get("SLURM_ARRAY_TASK_ID", "")}
    names |= {"%j": os.environ["SLURM_JOB_ID"], "%t": "0"}
    while command[0] in ("--output", "--error"):
        path = command[1]
        for pattern, value in names.items():
            path = path.replace(pattern, value)
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.dup2(file, 1 if command[0] == "--output" else 2)
        command = command[2:]
    os.execvp(command[0], command)


def scontrol(verb: str, name: str) -> None:
    assert verb == "requeue"
    launch(name, json.loads((STATE / f"{name}.json").read_text())["script"])


def sacct(*arguments: str) -> None:
    sys.stdout.write("JobID|State|NodeList\n")
    for path in STATE.glob("*.json"):
        running = Path(f"/proc/{json.loads(path.read_text())['pid']}").exists()
        sys.stdout.write(f"{path.stem}|{'RUNNING' if running else 'COMPLETED'}|here\n")


def scancel(name: str, *arguments: str) -> None:
    os.killpg(json.loads((STATE / f"{name}.json").read_text())["pid"], signal.SIGTERM)


if __name__ == "__main__":
    with (STATE / "calls.log").open("a") as file:
        file.write(" ".join([Path(sys.argv[0]).name, *sys.argv[1:]]) + "\n")
    globals()[Path(sys.argv[0]).name](*sys.argv[1:])
