"""The environments of gymnasium-robotics in stages keep the contract of tasks."""

from __future__ import annotations

import pytest

from causalbench.conformance.testing import TaskConformance


@pytest.mark.long
class TestFetchPickAndPlace(TaskConformance):
    task = "fetch_pick_and_place"
