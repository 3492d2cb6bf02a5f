"""Calls a function in a fresh Python process that has nothing of this one but its search path and environment."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

TIMEOUT = 300.0  # s


def in_new_process(function: Callable[..., Any], *arguments: Any) -> Any:
    """`function(*arguments)`, computed in a new process; all of it must be picklable.

    Raises `AssertionError` with the end of what the process printed when it does not return.
    """
    try:
        job = pickle.dumps((function, arguments))
    except Exception as error:  # pickle raises what the object's own methods raise
        raise AssertionError(
            f"what another process needs to make a scene cannot be pickled ({error}): "
            "`make` must be a function at the top level of a module"
        ) from error
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        (path / "job").write_bytes(job)
        # Through a file: some simulators greet the world on stdout.
        command = [sys.executable, "-c", "from causalbench.conformance.process import serve; serve()", str(path)]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        try:
            done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=TIMEOUT)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"a new process did not finish within {TIMEOUT:.0f} s") from None
        if done.returncode != 0:
            last = (done.stderr.strip() or f"exit code {done.returncode}").splitlines()[-1]
            raise AssertionError(f"a new process failed: {last}")
        return pickle.loads((path / "result").read_bytes())


def serve() -> None:
    """What the new process does."""
    path = Path(sys.argv[1])
    function, arguments = pickle.loads((path / "job").read_bytes())
    (path / "result").write_bytes(pickle.dumps(function(*arguments)))
