"""Pytest plugin of this repository: no skip and no expected failure that `tests/allowed_skips.txt` does not name.

A skipped or xfailed test that is not listed, or is listed with another reason, fails; an entry that no longer
matches anything is reported after a full run; a run in which no test ran to its end fails.
"""

from __future__ import annotations

import os
import re
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

# Before anything imports torch: on shared cores its threads wait for one another, and small networks need none.
os.environ.setdefault("OMP_NUM_THREADS", "1")

pytest_plugins = ("pytester", "backend_option")  # the latter is in tests/

LIST = "tests/allowed_skips.txt"


@dataclass(frozen=True)
class Entry:
    """One line of the list: `*` in `pattern` stands for anything, every other character for itself."""

    line: int
    pattern: str
    reason: str

    def matches(self, nodeid: str) -> bool:
        """Whether the node id is one that this entry names."""
        return re.fullmatch(re.escape(self.pattern).replace(r"\*", ".*"), nodeid, re.DOTALL) is not None


@dataclass
class Record:
    """What a session (or, under pytest-xdist, its controller) has seen."""

    entries: tuple[Entry, ...]
    executed: bool = False
    used: set[str] = field(default_factory=set)
    deselected: set[str] = field(default_factory=set)


RECORD = pytest.StashKey[Record]()


def read_entries(path: Path) -> tuple[Entry, ...]:
    """Entries of a list, one a line: `node id pattern | reason`; empty lines and # lines do not count."""
    entries = []
    for number, text in enumerate(path.read_text().splitlines() if path.exists() else (), start=1):
        if not text.strip() or text.startswith("#"):
            continue
        pattern, separator, reason = text.rpartition(" | ")
        if not separator or not pattern.strip() or not reason.strip():
            raise pytest.UsageError(f"{LIST}, line {number}: expected `node id pattern | reason`, found {text!r}")
        entries.append(Entry(number, pattern.strip(), reason.strip()))
    return tuple(entries)


def pytest_configure(config: pytest.Config) -> None:
    """Read the list once."""
    config.stash[RECORD] = Record(read_entries(config.rootpath / LIST))


def _police(config: pytest.Config, report: Any) -> None:
    """Turn a skip or xfail that is not listed into a failure; remember the entry that allows a listed one."""
    expected_failure = hasattr(report, "wasxfail")
    if not report.skipped and not expected_failure:
        return
    kind = "xfail" if expected_failure else "skip"
    longrepr = report.longrepr
    reason = report.wasxfail if expected_failure else longrepr[2] if isinstance(longrepr, tuple) else str(longrepr)
    named = [entry for entry in config.stash[RECORD].entries if entry.matches(report.nodeid)]
    for entry in named:
        if entry.reason in reason:
            report.allowed_by = entry.pattern
            return
    why = f"is listed with another reason ({named[0].reason!r})" if named else "is not listed"
    report.outcome = "failed"
    report.longrepr = f"{kind} of {report.nodeid} {why} in {LIST}; its reason: {reason.removeprefix('Skipped: ')!r}"
    if expected_failure:
        del report.wasxfail


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Police tests."""
    report = yield
    _police(item.config, report)
    return report


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Police modules that skip themselves as a whole."""
    report = yield
    _police(collector.config, report)
    return report


class Controller:
    """What only the process that prints the summary does."""

    def __init__(self, config: pytest.Config) -> None:
        self.config, self.record = config, config.stash[RECORD]

    def _note(self, report: Any) -> None:
        if allowed_by := getattr(report, "allowed_by", None):
            self.record.used.add(allowed_by)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note what ran and which entries were used."""
        self._note(report)
        if report.when == "call" and not report.skipped:
            self.record.executed = True

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Note which entries were used."""
        self._note(report)

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Take over from a pytest-xdist worker what it deselected."""
        self.record.deselected |= set(getattr(node, "workeroutput", {}).get("deselected", ()))

    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        """Fail a run that ran nothing."""
        if exitstatus == pytest.ExitCode.OK and not self.record.executed and not self.config.option.collectonly:
            session.exitstatus = pytest.ExitCode.NO_TESTS_COLLECTED

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Say what is stale and that nothing ran."""
        config = self.config
        if config.option.collectonly:
            return
        if not self.record.executed:
            terminalreporter.write_line("error: no test ran to its end, so this run shows nothing", red=True, bold=True)
        elif config.args_source is not pytest.Config.ArgsSource.ARGS and not config.option.keyword:
            for entry in self.record.entries:
                if entry.pattern not in self.record.used and not any(map(entry.matches, self.record.deselected)):
                    line = f"{LIST}, line {entry.line}: stale, nothing was skipped for {entry.pattern!r}"
                    terminalreporter.write_line(line, yellow=True)


@pytest.hookimpl(trylast=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Add the bookkeeping to the process that prints the summary."""
    if not hasattr(session.config, "workerinput"):
        session.config.pluginmanager.register(Controller(session.config), "causalbench-skips")


def pytest_deselected(items: Sequence[pytest.Item]) -> None:
    """Remember deselected tests: an entry for one of them is not stale."""
    if items:
        items[0].config.stash[RECORD].deselected |= {item.nodeid for item in items}


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Tell the pytest-xdist controller what this worker deselected."""
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["deselected"] = sorted(session.config.stash[RECORD].deselected)
