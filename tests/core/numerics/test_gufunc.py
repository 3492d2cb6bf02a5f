"""Compiled task functions: processes that compile them at the same time must leave a cache that can be used."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

START = """
import sys, numba
for i in range(int(sys.argv[1])):  # other work first, so that no two processes give a function the same number
    numba.njit(f"void(i{8 >> i % 3})")(lambda x: None)
from causalbench.core.tasks import pure_manipulation as task
assert task._tilt([0.0, 0.0, 1.0, 0.0]) == 0.0
"""


def _start(cache: Path, others: int) -> subprocess.Popen[bytes]:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    return subprocess.Popen([sys.executable, "-c", START, str(others)], env=environment)


@pytest.mark.long
def test_processes_that_compile_together_leave_a_usable_cache(tmp_path: Path) -> None:
    together = [_start(tmp_path, others) for others in (0, 1, 2)]
    assert [process.wait() for process in together] == [0] * 3
    assert any(tmp_path.rglob("*.nbi")), "nothing was cached"
    assert _start(tmp_path, 0).wait() == 0
