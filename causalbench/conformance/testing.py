"""`SceneConformance`: the contract as a class of pytest tests, which a plugin subclasses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar

from causalbench.conformance.bench import Bench
from causalbench.conformance.suite import CHECKS, FAIL, GAP, NOT_APPLICABLE, Check, check_gaps, run_check
from causalbench.plugins.manager import installed

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


def _test(check: Check) -> Callable[[SceneConformance, Bench], None]:
    def test(self: SceneConformance, bench: Bench) -> None:
        result = run_check(check, bench)
        if result.outcome == FAIL:
            pytest.fail(f"{result.number}. {result.sentence}\n{result.message}\n{result.place}", pytrace=False)
        if result.outcome == GAP:
            pytest.xfail(result.message)
        if result.outcome == NOT_APPLICABLE:
            pytest.skip(result.message)

    test.__name__ = check.test_name
    test.__qualname__ = f"SceneConformance.{check.test_name}"
    test.__doc__ = check.function.__doc__
    return test


for _check in CHECKS:
    setattr(SceneConformance, _check.test_name, _test(_check))
