"""The contract of a backend, one test a line: `pytest -k s13` runs S13 alone."""

from causalbench.conformance.testing import SceneConformance


class TestConformance(SceneConformance):
    """See the docstring of each test for what must hold."""

    backend = "hinge_arm"
