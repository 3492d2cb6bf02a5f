"""Folders that causalbench writes into: only those that it made, one command at a time, and never through a link."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from stored import finished

from causalbench.atomic import TEMPORARY
from causalbench.errors import RunFolderError
from causalbench.store.claim import claim, holder
from causalbench.store.run_folder import RunFolder


def everything(folder: Path) -> dict[str, bytes | str | None]:
    """Path below `folder` -> content of a file, target of a link, None for a folder."""
    return {
        str(path.relative_to(folder)): os.readlink(path)
        if path.is_symlink()
        else path.read_bytes()
        if path.is_file()
        else None
        for path in folder.rglob("*")
    }


def test_a_folder_is_for_one_command_at_a_time(tmp_path: Path) -> None:
    with RunFolder(tmp_path).claim(), pytest.raises(RunFolderError, match=rf"running here \(process {os.getpid()} on "):
        RunFolder(tmp_path).claim().__enter__()
    with RunFolder(tmp_path).claim():
        found = holder(tmp_path)
        assert found is not None
        assert found.pid == os.getpid()
    assert holder(tmp_path) is None


def test_a_killed_command_lets_go_of_its_folder(tmp_path: Path) -> None:
    code = (
        "import os, sys; from pathlib import Path; from causalbench.store.run_folder import RunFolder\n"
        "with RunFolder(Path(sys.argv[1])).claim(): os.kill(os.getpid(), 9)"
    )
    assert subprocess.run([sys.executable, "-c", code, str(tmp_path)]).returncode == -9
    assert holder(tmp_path) is None
    with RunFolder(tmp_path).claim():
        pass


def test_a_folder_that_cannot_be_written_is_the_users_mistake(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for path, reason in ((tmp_path / "file", "File exists"), (tmp_path / "file" / "below", "Not a directory")):
        with pytest.raises(RunFolderError, match=rf"{path}: cannot be written \({reason}\); choose another with --out"):
            RunFolder(path).claim().__enter__()


@pytest.mark.parametrize("kind", ["run", "discovery"])
@pytest.mark.parametrize(
    "theirs", [["results.csv"], ["suite.yaml", ".notes.tmp"], [".cache.tmp/thesis.tex"], ["run.json"]]
)
def test_a_folder_with_content_of_others_is_refused_and_stays_as_it_was(
    kind: str, theirs: list[str], tmp_path: Path
) -> None:
    for name in theirs:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("my own")
    before = everything(tmp_path)
    with pytest.raises(RunFolderError, match=f"^{tmp_path}: not empty .*; choose another with --out"):
        claim(tmp_path, kind).__enter__()
    assert everything(tmp_path) == before


def test_a_folder_made_for_a_discovery_is_none_for_a_run(tmp_path: Path) -> None:
    with claim(tmp_path / "d", "discovery"):
        (tmp_path / "d" / "graph.json").touch()
    with claim(tmp_path / "d", "discovery"):
        pass
    with pytest.raises(RunFolderError, match=r"'graph.json' is there.* did not make it for a run"):
        RunFolder(tmp_path / "d").claim().__enter__()


def test_a_folder_whose_marker_is_damaged_is_known_by_its_cells(tmp_path: Path) -> None:
    finished(RunFolder(tmp_path))
    (tmp_path / "run.json").write_text("")
    with RunFolder(tmp_path).claim():
        pass
    assert (tmp_path / "run.json").read_text() != ""


@pytest.mark.parametrize("name", ["cells", "discovery", ".lock"])
def test_a_link_of_a_stranger_is_not_followed(name: str, tmp_path: Path) -> None:
    run, theirs = tmp_path / "run", tmp_path / "theirs"
    with RunFolder(run).claim():
        pass
    if name == ".lock":
        theirs.write_text("my own")
    else:
        theirs.mkdir()
        (theirs / f".x.7{TEMPORARY}").touch()
    path = run / name
    path.unlink() if path.is_file() else path.rmdir()
    path.symlink_to(theirs)
    before = everything(tmp_path)
    with pytest.raises(RunFolderError, match=f"{path}: "):
        RunFolder(run).claim().__enter__()
    assert everything(tmp_path) == before


def test_what_a_killed_command_was_writing_is_swept_and_no_more(tmp_path: Path) -> None:
    run = RunFolder(tmp_path / "run")
    with run.claim():
        cell = finished(run)
    outside, folder = tmp_path / "outside", run.folder(cell)
    outside.mkdir()
    (folder / "data").mkdir()
    (folder / "mine").mkdir()
    half = f".half.7{TEMPORARY}"
    swept = [run.path / half, folder / half, folder / "data" / half]
    kept = [outside / half, folder / "mine" / half, run.path / ".notes.tmp", folder / ".notes.tmp"]
    for path in [*swept, *kept]:
        path.touch()
    (run.path / "cells" / "link").symlink_to(outside)
    with run.claim():
        pass
    assert [path.exists() for path in swept] == [False] * 3
    assert [path.exists() for path in kept] == [True] * 4
