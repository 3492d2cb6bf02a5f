"""What people and strangers hand in, made up by hypothesis: suites, arguments, tables and run folders.

It is taken or refused in a sentence. `FUZZ_INPUTS=10000 pytest tests/test_fuzz.py` tries as many of each.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from causalbench.cli import app
from causalbench.errors import UserError
from causalbench.plugins.manager import installed
from causalbench.report.frames import load_results
from causalbench.run.watch import run_status
from causalbench.store.run_folder import RunFolder
from causalbench.suite.schema import load_suite
from conftest import TINY

fuzzed = settings(
    max_examples=int(os.environ.get("FUZZ_INPUTS", "25")),
    deadline=5_000,
    derandomize="FUZZ_INPUTS" not in os.environ,
    suppress_health_check=list(HealthCheck),
    database=None,
)

SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=12)
KEYS = st.sampled_from([*yaml.safe_load(TINY), "grid", "per_backend", "hypotheses", "seeds", "env_steps", "kl"])
NESTED = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS | st.text(max_size=5), inner, max_size=3)
)
BYTES = st.binary(max_size=8) | st.sampled_from(
    [b"\x00", b"\xff\xfe", b"1e999", b"nan", b"-1", b"9" * 400, b'"', b",", b"\n", b"[[[[", b"{}", b"\x1b[2J", b"=1+1"]
)
CHANGES = st.lists(st.tuples(st.floats(0, 1), st.integers(0, 40), BYTES), min_size=1, max_size=4)


def changed(content: bytes, changes: list[tuple[float, int, bytes]]) -> bytes:
    """`content` with pieces replaced: (where, as a share of it; how many bytes; by what)."""
    for place, length, piece in changes:
        at = int(place * len(content))
        content = content[:at] + piece + content[at + length :]
    return content


def complaint(read: Callable[[], object]) -> str:
    """What `read` says is wrong; "" if it reads."""
    try:
        read()
    except UserError as error:
        return str(error)
    return ""


@fuzzed
@given(st.dictionaries(KEYS, NESTED, max_size=4), st.sets(KEYS, max_size=2), CHANGES | st.none())
def test_a_suite_is_loaded_or_its_mistake_is_named(
    suite_path: Path, given: dict[str, Any], missing: set[str], changes: list[tuple[float, int, bytes]] | None
) -> None:
    content = {key: value for key, value in (yaml.safe_load(TINY) | given).items() if key not in missing}
    data = yaml.safe_dump(content, allow_unicode=True).encode("utf-8", "surrogatepass")
    suite_path.write_bytes(changed(data, changes) if changes else data)
    assert str(suite_path) in (complaint(lambda: load_suite(suite_path, installed())) or str(suite_path))


# Without `run` and `discover`, which would do their work.
WORDS = st.sampled_from(
    [
        "plan", "status", "leaderboard", "play", "reversals", "transfer", "backends", "--tier", "--seeds",
        "--only", "--out", "--jobs", "--json", "--measure", "--help", "seed=0", "method=", "=", "pure_manip", "smoke",
        "missing.yaml", "-1", "0", "kinematic", "--backend", "--version", "--", "\x1b[31m", "/dev/null", ".", "..",
    ]
)  # fmt: skip


@fuzzed
@given(st.lists(WORDS | st.text(max_size=6), max_size=7))
def test_arguments_are_taken_or_refused_without_a_traceback(
    here: Path, printed: Callable[[], str], words: list[str]
) -> None:
    argv = ["causalbench", *(word.replace("--measure", "--json") for word in words)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", argv)
        patch.setenv(app.TRACEBACK, "1")  # an unexpected error is raised
        with pytest.raises(SystemExit) as ended:
            app.main()
    assert ended.value.code in (0, 1, 2, None)
    assert "\x1b[31m" not in printed()
    assert not [*here.iterdir()]


@fuzzed
@given(st.data(), CHANGES)
def test_a_run_folder_with_a_changed_file_is_read_and_what_is_damaged_is_named(
    run: Path, data: st.DataObject, changes: list[tuple[float, int, bytes]]
) -> None:
    """By what `status` reads, and by what loads its tables."""
    files = sorted(path for path in run.rglob("*") if path.is_file() and path.suffix in (".json", ".csv", ".yaml"))
    path = data.draw(st.sampled_from(files))
    content = path.read_bytes()
    path.write_bytes(changed(content, changes))
    try:
        folder = RunFolder(run)
        sentences = [complaint(lambda: run_status(folder)), complaint(lambda: load_results(run)), *folder.problems()]
        assert all(str(run) in sentence for sentence in sentences if sentence)
    finally:
        path.write_bytes(content)


@pytest.fixture(scope="module")
def suite_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz") / "suite.yaml"


@pytest.fixture(scope="module")
def run(finished_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copytree(finished_run, tmp_path_factory.mktemp("fuzz") / "run"))


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def printed(capsys: pytest.CaptureFixture[str]) -> Callable[[], str]:
    return lambda: "".join(capsys.readouterr())
