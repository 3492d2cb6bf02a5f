"""What lies beside a film."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from causalbench.errors import DamagedFileError
from causalbench.store.films import Film, read_film, write_film

FILM = Film(10.0, 4, "1x12 2x5 1x3 5x10")


def test_what_is_read_is_what_was_written(tmp_path: Path) -> None:
    video = tmp_path / "cell.mp4"
    video.write_bytes(b"film")
    write_film(video, FILM)
    assert read_film(video) == FILM
    assert read_film(video).runs == [(1, 12), (2, 5), (1, 3), (5, 10)]


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("fps", 0, "fps"),
        ("stages", "1x12,2x5", "no stage trace"),
        ("stages", "6x1", "a stage beyond 5"),
        ("schema", 0, "film it again"),
    ],
)
def test_what_is_not_is_refused(tmp_path: Path, key: str, value: object, message: str) -> None:
    video = tmp_path / "cell.mp4"
    video.write_bytes(b"film")
    write_film(video, FILM)
    path = video.with_suffix(".json")
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))
    with pytest.raises(DamagedFileError, match=message):
        read_film(video)


def test_a_film_that_is_a_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").write_bytes(b"film")
    (tmp_path / "cell.mp4").symlink_to(tmp_path / "elsewhere")
    write_film(tmp_path / "cell.mp4", FILM)
    with pytest.raises(DamagedFileError, match="a link"):
        read_film(tmp_path / "cell.mp4")
