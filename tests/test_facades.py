"""What authors of backends and tasks import: facades are whole, cost little, and are all that examples use."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import causalbench
from causalbench import backend, discoverer, learner, method, task, worlds

ROOT = Path(__file__).parents[1]
OPEN = re.compile(r"causalbench(\.backend|\.task|\.core\.kit(\.\w+)*|\.conformance\.testing)?")
PLACES = [
    *(ROOT / "examples" / "hinge_arm_backend").rglob("*.py"),
    *(ROOT / "causalbench" / "scaffold" / "templates").rglob("*.template"),
    ROOT / "docs" / "plugins.md",
    ROOT / "docs" / "tutorial_backend.md",
]


FACADES = (causalbench, backend, discoverer, learner, method, task, worlds)


@pytest.mark.parametrize("facade", FACADES, ids=lambda facade: facade.__name__)
def test_every_name_of_a_facade_is_there(facade: ModuleType) -> None:
    assert len(set(facade.__all__)) == len(facade.__all__)
    assert [name for name in facade.__all__ if getattr(facade, name, None) is None] == []


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    for facade in FACADES:
        with pytest.raises(AttributeError, match=rf"module '{facade.__name__}' has no attribute 'nothing'"):
            facade.nothing  # noqa: B018


def test_the_facade_imports_neither_simulators_nor_what_takes_time() -> None:
    heavy = ("torch", "numba", "mujoco", "pybullet", "stable_baselines3", "scipy", "matplotlib")
    script = f"import sys, causalbench.backend; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize("place", PLACES, ids=lambda place: str(place.relative_to(ROOT)))
def test_pages_and_examples_import_the_facade_and_the_kit_alone(place: Path) -> None:
    found = re.findall(r"^\s*(?:from|import) (causalbench[\w.]*)", place.read_text(), re.MULTILINE)
    ours = [name for name in found if re.match(r"causalbench(\.|$)", name)]
    assert [name for name in ours if not OPEN.fullmatch(name)] == []
