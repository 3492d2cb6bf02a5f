"""A command that is killed, as by kill -9, after so much progress, however fast the machine is.

Progress is counted in moves on the run folder: every file that is begun, and every file or folder that is moved into
place. All processes of the command count together.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from pathlib import Path

HOOK = '''
"""Imported by every interpreter of the command as it starts."""
import os, signal, sys

MOVES, LAST = os.environ["MOVES"], int(os.environ["LAST_MOVE"])
COMMAND = int(os.environ.setdefault("COMMAND", str(os.getpid())))  # the first interpreter is the command itself

def hook(event, arguments):
    if event not in ("open", "os.rename") or ".causalbench-tmp" not in str(arguments[0]):
        return
    if event == "open" and not arguments[2] & os.O_CREAT:
        return
    moves = os.open(MOVES, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(moves, b".")
    done = os.fstat(moves).st_size
    os.close(moves)
    if done == LAST:
        os.kill(COMMAND, signal.SIGKILL)
        if os.environ["WRITER_TOO"]:
            os.kill(os.getpid(), signal.SIGKILL)

sys.addaudithook(hook)
'''
"""An append is one step, so that each process learns which move its own was."""


def call_until(command: list[str], folder: Path, last_move: int = 0, writer_too: bool = False) -> tuple[int, int]:
    """Run `command` and kill it as it makes its `last_move`-th move; 0 never does. Its exit code and how many it made.

    With `writer_too` the process that makes the last move, perhaps a cell's, dies before it is made; otherwise that
    goes on until it notices. `folder` is the caller's own, for what is needed.
    """
    here = Path(tempfile.mkdtemp(dir=folder))
    (here / "sitecustomize.py").write_text(HOOK)
    moves = here / "moves"
    moves.touch()
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(filter(None, [str(here), os.environ.get("PYTHONPATH")])),
        "MOVES": str(moves),
        "LAST_MOVE": str(last_move),
        "WRITER_TOO": "yes" if writer_too else "",
    }
    done = subprocess.run(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return done.returncode, moves.stat().st_size
