"""The reference backend keeps the contract."""

from __future__ import annotations

from causalbench.conformance.testing import SceneConformance


class TestConformance(SceneConformance):
    backend = "kinematic"
