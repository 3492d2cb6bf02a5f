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


@pytest.fixture(params=[(), ("-n", "1")], ids=["plain", "xdist"])
def run(pytester: pytest.Pytester, request: pytest.FixtureRequest):
    def run(allowed: str, *arguments: str, **modules: str) -> pytest.RunResult:
        pytester.makeconftest(CONFTEST.read_text().replace("pytest_plugins =", "unused ="))
        pytester.makeini("[pytest]\ntestpaths = tests\nmarkers =\n    long: slow\n")
        folder = pytester.mkdir("tests")
        (folder / "allowed_skips.txt").write_text(allowed)
        for name, source in modules.items():
            (folder / f"{name}.py").write_text(source)
        return pytester.runpytest_subprocess("-p", "no:cacheprovider", *request.param, *arguments)

    return run


@pytest.mark.parametrize(
    ("source", "line"),
    [
        (SKIPS, "*skip of tests/test_b.py::test_skips is not listed*'no such device'*"),
        (MARKED, "*skip of tests/test_b.py::test_skips?a? is not listed*'no such device'*"),
        (XFAILS, "*xfail of tests/test_b.py::test_xfails is not listed*'known bug'*"),
        (MODULE, "*skip of tests/test_b.py is not listed*no_such_module*"),
    ],
    ids=["call", "mark", "xfail", "module"],
)
def test_an_unlisted_skip_fails_the_run(run, source, line):
    result = run("", test_a=PASSES, test_b=source)
    assert result.ret != 0
    result.stdout.fnmatch_lines([line])
    assert "stale, nothing" not in result.stdout.str()


@pytest.mark.parametrize(
    ("source", "allowed"),
    [
        (SKIPS, "tests/test_b.py::test_skips | no such device"),
        (MARKED, "# why\n\ntests/test_b.py::test_skips[*] | no such"),
        (XFAILS, "tests/*::test_xfails | known bug"),
        (MODULE, "tests/test_b.py | no_such_module"),
    ],
    ids=["call", "mark", "xfail", "module"],
)
def test_a_listed_skip_passes(run, source, allowed):
    result = run(allowed, test_a=PASSES, test_b=source)
    assert result.ret == 0
    assert "stale, nothing" not in result.stdout.str()


def test_a_listed_skip_with_another_reason_fails(run):
    result = run("tests/test_b.py::test_skips | too slow", test_a=PASSES, test_b=SKIPS)
    assert result.ret == 1
    result.stdout.fnmatch_lines(["*test_skips is listed with another reason ('too slow')*'no such device'*"])


def test_an_unused_entry_is_reported_after_a_full_run_only(run):
    result = run("tests/test_gone.py::test_x | gone", test_a=PASSES)
    assert result.ret == 0
    result.stdout.fnmatch_lines(["tests/allowed_skips.txt, line 1: stale*'tests/test_gone.py::test_x'"])


@pytest.mark.parametrize("arguments", [("tests/test_a.py",), ("-k", "passes")], ids=["path", "keyword"])
def test_a_partial_run_calls_nothing_stale(run, arguments):
    result = run("tests/test_b.py::test_skips | no such device", *arguments, test_a=PASSES, test_b=SKIPS)
    assert result.ret == 0
    assert "stale, nothing" not in result.stdout.str()


def test_an_entry_for_a_deselected_test_is_not_stale(run):
    allowed = "tests/test_b.py::test_skips | no such device\ntests/test_gone.py | gone"
    result = run(allowed, "-m", "not long", test_a=PASSES, test_b=SKIPS.replace("def ", "@pytest.mark.long\ndef "))
    assert result.ret == 0
    result.stdout.fnmatch_lines(["*line 2: stale*"])
    result.stdout.no_fnmatch_line("*line 1: stale*")


@pytest.mark.parametrize("arguments", [("-m", "long"), ("-k", "nothing")], ids=["marker", "keyword"])
def test_a_run_of_nothing_is_not_green(run, arguments):
    result = run("", *arguments, test_a=PASSES)
    assert result.ret == pytest.ExitCode.NO_TESTS_COLLECTED
    result.stdout.fnmatch_lines(["error: no test ran to its end*"])


def test_a_run_of_allowed_skips_alone_is_not_green(run):
    result = run("tests/test_b.py::test_skips | no such device", test_b=SKIPS)
    assert result.ret == pytest.ExitCode.NO_TESTS_COLLECTED
    result.stdout.fnmatch_lines(["error: no test ran to its end*"])


def test_an_empty_folder_is_not_green(run):
    assert run("").ret == pytest.ExitCode.NO_TESTS_COLLECTED


def test_a_malformed_list_names_its_line(run):
    result = run("\ntests/test_a.py without a reason", test_a=PASSES)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["*allowed_skips.txt, line 2: expected*"])
