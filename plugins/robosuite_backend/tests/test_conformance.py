"""The contract of docs/conformance.md; the other tests here are about this plugin alone."""

from __future__ import annotations

from causalbench.conformance.testing import SceneConformance


class TestConformance(SceneConformance):
    backend = "robosuite"
