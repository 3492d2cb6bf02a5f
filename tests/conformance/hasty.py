"""A plugin module that imports its simulator at once, although only `make` may."""

from __future__ import annotations

from conformance import pretend_simulator

from causalbench.core.kinematic.worlds import KinematicScene


def make() -> KinematicScene:
    """A scene that is right in every other way."""
    assert pretend_simulator
    return KinematicScene()
