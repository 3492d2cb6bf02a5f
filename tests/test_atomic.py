"""Atomic files: the old content or the new, and nothing but what stands at the target."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from causalbench import atomic


def test_a_write_that_is_cut_short_leaves_the_old_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "status.json"
    atomic.write_text(path, "old")

    def die(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", die)
    with pytest.raises(KeyboardInterrupt):
        atomic.write_text(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_appears_only_when_it_is_complete(tmp_path: Path) -> None:
    def fill(folder: Path) -> None:
        (folder / "a").write_text("1")
        assert not (tmp_path / "policy").exists()

    atomic.write_folder(tmp_path / "policy", fill)
    atomic.write_folder(tmp_path / "policy", lambda folder: (folder / "b").touch())
    assert [p.name for p in (tmp_path / "policy").iterdir()] == ["b"]


def test_a_link_is_replaced_and_never_written_through(tmp_path: Path) -> None:
    """Neither one at the target nor one that waits under the temporary name; the same for folders."""
    theirs, folder = tmp_path / "theirs", tmp_path / "folder"
    theirs.write_text("years of work")
    folder.mkdir()
    (folder / "more").write_text("work")
    (tmp_path / "a").symlink_to(theirs)
    (tmp_path / f".b.{os.getpid()}{atomic.TEMPORARY}").symlink_to(theirs)
    (tmp_path / "c").symlink_to(folder)
    atomic.write_text(tmp_path / "a", "ours")
    atomic.write_text(tmp_path / "b", "ours")
    atomic.write_folder(tmp_path / "c", lambda path: (path / "d").touch())
    assert theirs.read_text() == "years of work"
    assert (folder / "more").read_text() == "work"
    assert [(tmp_path / name).is_symlink() for name in "abc"] == [False] * 3


def test_only_what_we_were_writing_is_swept_and_no_folder_entered(tmp_path: Path) -> None:
    theirs = [".notes.tmp", ".b.77.tmp", ".causalbench", "a.causalbench-tmp", "causalbench-tmp.txt"]
    for name in theirs:
        (tmp_path / name).touch()
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / f".x.7{atomic.TEMPORARY}").touch()
    (tmp_path / f".policy.7{atomic.TEMPORARY}").mkdir()
    (tmp_path / f".policy.7{atomic.TEMPORARY}" / "half").touch()
    (tmp_path / f".link.7{atomic.TEMPORARY}").symlink_to(tmp_path / "below")
    atomic.sweep(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*theirs, "below"])
    assert len(list((tmp_path / "below").iterdir())) == 1
