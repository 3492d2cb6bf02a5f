"""`--executor ray`: cells as tasks on a cluster of several nodes, one of which dies in mid-run."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from runs import results

from causalbench.errors import UserError
from causalbench.run.cell import Keeping
from causalbench.run.executors.ray import Ray
from causalbench.store.run_folder import RunFolder

ONCE = """
import os, sys

def hook(event, arguments):
    # Tell the test, once, that a checkpoint is in place; it answers by killing this node.
    if event == "os.rename" and str(arguments[1]).endswith("checkpoint.safetensors"):
        fifo = os.environ["CHECKPOINT_FIFO"]
        try:
            os.close(os.open(fifo + ".told", os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            return
        with open(fifo, "w") as file:
            file.write(os.environ["NODE"])

sys.addaudithook(hook)
"""


def test_a_cluster_that_is_not_there_is_told_so(tmp_path: Path) -> None:
    pytest.importorskip("ray", reason="the extra ray is not installed")
    with pytest.raises(UserError, match=r"127\.0\.0\.1:1: no Ray cluster answers"):
        Ray(RunFolder(tmp_path), Keeping(), None, "127.0.0.1:1")


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Three nodes on this machine: a head without cores and two that work, whose checkpoints go through a FIFO."""
    pytest.importorskip("ray", reason="the extra ray is not installed")
    from ray.cluster_utils import Cluster

    (tmp_path / "sitecustomize.py").write_text(ONCE)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("CHECKPOINT_FIFO", str(tmp_path / "fifo"))
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
    nodes = {}
    for name in ("first", "second"):
        nodes[name] = made.add_node(num_cpus=2, env_vars={"NODE": name})
    yield made, nodes
    made.shutdown()


@pytest.mark.long
def test_a_node_that_dies_changes_no_byte(
    cluster: tuple[Any, dict[str, Any]], finished_run: Path, tiny_suite: Path, command: list[str], tmp_path: Path
) -> None:
    import os

    made, nodes = cluster
    os.mkfifo(tmp_path / "fifo")
    out = tmp_path / "run"
    call = [*command, "run", str(tiny_suite), "--tier", "smoke", "--out", str(out), "--quiet"]
    call += ["--executor", "ray", "--ray-address", made.address, "--checkpoint-every", "20"]
    with subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        with (tmp_path / "fifo").open() as fifo:  # opens once a cell has written a checkpoint
            victim = fifo.read()
        made.remove_node(nodes[victim], allow_graceful=False)
        _, errors = process.communicate()
    assert process.returncode == 0, errors
    assert results(out) == results(finished_run)
    logs = [path.read_text() for path in out.glob("cells/*/log.txt")]
    assert sum("continued from the checkpoint" in log for log in logs) >= 1
