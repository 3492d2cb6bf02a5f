"""A plugin module that imports its simulator at once, although only `make` may."""

from __future__ import annotations

from conformance import pretend_simulator

from causalbench.core import kinematic
from causalbench.core.kinematic.scenes import WorldsScene


def make() -> WorldsScene:
    """A scene that is right in every other way."""
    assert pretend_simulator
    return kinematic.make()
