"""The skip policy of the root conftest, tried in pytest runs of its own."""

from __future__ import annotations

from pathlib import Path

import pytest

CONFTEST = Path(__file__).parents[1] / "conftest.py"
PASSES = "def test_passes():\n    assert True\n"
SKIPS = "import pytest\ndef test_skips():\n    pytest.skip('no such device')\n"
MARKED = """
import pytest
@pytest.mark.skipif(True, reason="no such device")
@pytest.mark.parametrize("x", ["a"])
def test_skips(x): ...
"""
XFAILS = "import pytest\n@pytest.mark.xfail(reason='known bug')\ndef test_xfails():\n    assert False\n"
MODULE = "import pytest\npytest.importorskip('no_such_module')\ndef test_never(): ...\n"


@pytest.fixture
def run(pytester: pytest.Pytester):
    def run(allowed: str, source: str) -> pytest.RunResult:
        pytester.makeconftest(CONFTEST.read_text().replace("pytest_plugins =", "unused ="))
        folder = pytester.mkdir("tests")
        (folder / "allowed_skips.txt").write_text(allowed)
        (folder / "test_a.py").write_text(PASSES)
        (folder / "test_b.py").write_text(source)
        return pytester.runpytest_subprocess("-p", "no:cacheprovider")

    return run


CASES = pytest.mark.parametrize(
    ("source", "test", "reason"),
    [
        (SKIPS, "tests/test_b.py::test_skips", "no such device"),
        (MARKED, "tests/test_b.py::test_skips[[]a[]]", "no such device"),
        (XFAILS, "tests/test_b.py::test_xfails", "known bug"),
        (MODULE, "tests/test_b.py", "no_such_module"),
    ],
    ids=["call", "mark", "xfail", "module"],
)


@CASES
def test_an_unlisted_skip_fails_the_run(run, source, test, reason):
    result = run("# nothing is allowed\n", source)
    assert result.ret != 0
    result.stdout.fnmatch_lines([f"*not in tests/allowed_skips.txt: {test} | *{reason}*"])


@CASES
def test_a_skip_passes_only_with_the_reason_that_is_listed(run, source, test, reason):
    assert run(f"# why\n\ntests/*b.py* | {reason}", source).ret == 0


def test_a_listed_skip_with_another_reason_fails(run):
    assert run("tests/test_b.py::test_skips | too slow", SKIPS).ret == 1
