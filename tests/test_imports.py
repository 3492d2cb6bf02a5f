"""What importing causalbench must not import."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = {"torch", "stable_baselines3", "gymnasium_robotics", "mujoco", "pybullet", "robosuite", "matplotlib", "pandas"}


@pytest.mark.parametrize(
    "statement",
    [
        "import causalbench",
        "import causalbench.discoverer",
        "import causalbench.learner",
        "import causalbench.method",
        "import causalbench.plugins.hookspecs",
        "import causalbench.report",
    ],
)
def test_imports_nothing_heavy(statement):
    script = f"import sys; {statement}; print(*sorted(m for m in sys.modules if '.' not in m))"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, stdin=subprocess.DEVNULL
    )
    assert not HEAVY & set(done.stdout.split())
