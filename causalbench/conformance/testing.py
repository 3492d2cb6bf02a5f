"""The contracts as classes of pytest tests, which a plugin subclasses: `SceneConformance` and `TaskConformance`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, ClassVar

from causalbench.conformance.bench import Bench
from causalbench.conformance.check import FAIL, GAP, NOT_APPLICABLE, Check, OnTheBench, run_check
from causalbench.conformance.suite import CHECKS, check_gaps
from causalbench.conformance.task_bench import TaskBench
from causalbench.conformance.task_suite import TASK_CHECKS
from causalbench.plugins.manager import installed
from causalbench.plugins.venues import venue_of

try:
    import pytest
except ImportError as error:
    raise ImportError("causalbench.conformance.testing needs pytest; run: pip install pytest") from error


class SceneConformance:
    """One test per line of docs/conformance.md.

    A subclass, named `Test...`, sets `backend` to the registered name and, if it likes, `options` to those of `make`.
    A line that does not apply is skipped; a known gap is an expected failure, and fails once it passes.
    """

    backend: ClassVar[str]
    options: ClassVar[Mapping[str, Any]] = {}

    @pytest.fixture(scope="class")
    def bench(self, request: pytest.FixtureRequest) -> Iterator[Bench]:
        """The backend under test, its scenes closed at the end."""
        backend = installed().backend(request.cls.backend)
        check_gaps(backend.known_gaps)
        bench = Bench(backend, request.cls.options)
        yield bench
        bench.close()


class TaskConformance:
    """One test per line of docs/task_conformance.md.

    A subclass, named `Test...`, sets `task` to the registered name and, if it likes, `backend` to one that runs it and
    `options` to those of that backend; without a backend it is the task's own. A line that does not apply is skipped.
    """

    task: ClassVar[str]
    backend: ClassVar[str | None] = None
    options: ClassVar[Mapping[str, Any]] = {}

    @pytest.fixture(scope="class")
    def bench(self, request: pytest.FixtureRequest) -> Iterator[TaskBench]:
        """The task under test, its worlds closed at the end."""
        plugins, asked = installed(), request.cls
        task = plugins.task(asked.task)
        bench = TaskBench(task, plugins.backend(asked.backend or venue_of(task).home), asked.options)
        yield bench
        bench.close()


def _test(check: Check) -> Callable[[Any, OnTheBench], None]:
    def test(self: Any, bench: OnTheBench) -> None:
        result = run_check(check, bench)
        if result.outcome == FAIL:
            pytest.fail(f"{result.number}. {result.sentence}\n{result.message}\n{result.place}", pytrace=False)
        if result.outcome == GAP:
            pytest.xfail(result.message)
        if result.outcome == NOT_APPLICABLE:
            pytest.skip(result.message)

    return test


def _add_tests(suite: type, checks: Iterable[Check]) -> None:
    """Give `suite` a test per check."""
    for check in checks:
        test = _test(check)
        test.__name__, test.__doc__ = check.test_name, check.function.__doc__
        test.__qualname__ = f"{suite.__name__}.{check.test_name}"
        setattr(suite, check.test_name, test)


_add_tests(SceneConformance, CHECKS)
_add_tests(TaskConformance, TASK_CHECKS)
