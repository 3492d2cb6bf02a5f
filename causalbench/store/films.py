"""Films of policies in a run folder: `videos/<cell id>.mp4`, and beside each a .json with the stage of every frame."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Gt

from causalbench import formats
from causalbench.atomic import write_json
from causalbench.errors import DamagedFileError
from causalbench.store.episodes import RUN
from causalbench.store.files import check_file, read_json, validated

VIDEOS = "videos"


@dataclass(frozen=True)
class Film:
    """What a film shows: `stages` is the stage of every frame in run-length form, n_stages + 1 once it succeeded."""

    fps: Annotated[float, Gt(0)]
    n_stages: Annotated[int, Ge(1)]
    stages: str

    @property
    def runs(self) -> list[tuple[int, int]]:
        """(stage, frames) of every stretch in one stage. Raises `ValueError` for a text that is no such form."""
        found = [RUN.fullmatch(run) for run in self.stages.split(" ")]
        if not all(found):
            raise ValueError(f"{self.stages[:40]!r} is no stage trace such as '1x12 2x5'")
        return [(int(run[1]), int(run[2])) for run in found if run]


def write_film(video: Path, film: Film) -> None:
    """Say beside the file `video` what it shows."""
    write_json(video.with_suffix(".json"), {"schema": formats.RUN} | asdict(film))


def read_film(video: Path) -> Film:
    """What the file `video` shows. Raises `DamagedFileError` unless both files are there and as they were written."""
    check_file(video)
    path = video.with_suffix(".json")
    content = read_json(path)
    if content.get("schema") != formats.RUN:
        raise DamagedFileError(f"{path}: schema {content.get('schema')!r}, expected {formats.RUN}; film it again")
    film = validated(path, Film, content)
    try:
        within = all(stage <= film.n_stages + 1 for stage, _ in film.runs)
    except ValueError as error:
        raise DamagedFileError(f"{path}: {error}") from None
    if not within:
        raise DamagedFileError(f"{path}: names a stage beyond {film.n_stages + 1}")
    return film
