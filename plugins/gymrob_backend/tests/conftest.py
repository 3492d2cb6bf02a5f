from __future__ import annotations

import pytest

from causalbench.core.scene import Scene
from causalbench_gymrob import make


@pytest.fixture(scope="session")
def scene() -> Scene:
    return make()
