"""Pytest plugin of this repository: a skip or expected failure that `tests/allowed_skips.txt` does not name fails."""

from __future__ import annotations

import os
import re
from collections.abc import Generator
from typing import Any

import pytest

# Before anything imports torch: on shared cores its threads wait for one another, and small networks need none.
os.environ.setdefault("OMP_NUM_THREADS", "1")

pytest_plugins = ("pytester", "backend_option")  # the latter is in tests/

LIST = "tests/allowed_skips.txt"


def _is_allowed(config: pytest.Config, nodeid: str, reason: str) -> bool:
    """Whether a line of the list, `node id pattern | reason`, names the test; `*` stands for anything."""
    lines = [line for line in (config.rootpath / LIST).read_text().splitlines() if line and line[0] != "#"]
    entries = [line.rsplit(" | ", 1) for line in lines]
    return any(
        re.fullmatch(re.escape(pattern).replace(r"\*", ".*"), nodeid, re.DOTALL) and expected in reason
        for pattern, expected in entries
    )


def _police(config: pytest.Config, report: Any) -> Any:
    """Turn a skip or xfail that is not listed into a failure."""
    if report.skipped:
        longrepr = report.longrepr
        reason = getattr(report, "wasxfail", longrepr[2] if isinstance(longrepr, tuple) else str(longrepr))
        if not _is_allowed(config, report.nodeid, reason):
            report.outcome, report.longrepr = "failed", f"not in {LIST}: {report.nodeid} | {reason}"
            report.__dict__.pop("wasxfail", None)
    return report


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, Any]:
    """Police tests."""
    return _police(item.config, (yield))


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Generator[None, Any, Any]:
    """Police modules that skip themselves as a whole."""
    return _police(collector.config, (yield))
