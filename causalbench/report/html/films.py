"""The section on films: what final policies do, with a ribbon of their stages in step with the video."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from causalbench.errors import DamagedFileError
from causalbench.report.drawing import STAGE_COLOURS
from causalbench.report.html.parts import FilmBlock, Note, Section, Stretch, data_uri
from causalbench.report.html.source import Source
from causalbench.report.html.wording import count
from causalbench.report.leaderboard import at_point
from causalbench.store.cells import StoredCell
from causalbench.store.films import VIDEOS, Film, read_film

MOST_FILMS = 12
MOST_BYTES = 9_000_000
"""What the films of a page may take together, so that it stays below 15 MB."""
LEAD = (
    "Deterministic episodes of final policies, on the starts of the evaluation. The ribbon below a film is its stages, "
    "the needle where the film is; a click on the ribbon goes there."
)


def section(source: Source) -> Section:
    """The films that lie in the run folder, one a method and backend."""
    blocks: list[Any] = []
    taken = left = 0
    for cell, video in _videos(source):
        try:
            film, size = read_film(video), video.stat().st_size
        except DamagedFileError as error:
            blocks.append(Note(f"Not shown: {error}", "warn"))
            continue
        if len(blocks) >= MOST_FILMS or taken + size > MOST_BYTES:
            left += 1
            continue
        taken += size
        blocks.append(_film(cell, video, film))
    if left:
        blocks.append(
            Note(f"{count(left, 'film')} more in {VIDEOS}/ of the run folder: the page has no room for them.")
        )
    if not blocks:
        blocks = [Note("No films yet: causalbench play RUN makes them, and causalbench report RUN shows them.")]
    return Section("films", "Films of final policies", LEAD, blocks)


def _videos(source: Source) -> Iterator[tuple[StoredCell, Path]]:
    """The first film of each backend, method and point of a grid."""
    seen = set()
    for cell in source.learned:
        video, of = source.run.path / VIDEOS / f"{cell.id}.mp4", (cell.backend, cell.method, cell.grid_point)
        if of not in seen and video.exists():
            seen.add(of)
            yield cell, video


def _film(cell: StoredCell, video: Path, film: Film) -> FilmBlock:
    total, at, ribbon = sum(frames for _, frames in film.runs), 0, []
    for stage, frames in film.runs:
        success = stage > film.n_stages
        name = "success" if success else f"stage {stage} of {film.n_stages}"
        colour = "var(--good)" if success else STAGE_COLOURS[(stage - 1) % len(STAGE_COLOURS)]
        ribbon.append(Stretch(name, colour, 100 * at / total, 100 * frames / total, at / film.fps))
        at += frames
    title = f"{at_point(cell.method, cell.grid_point)} on {cell.backend}, seed {cell.seed}"
    return FilmBlock(title, data_uri("video/mp4", video.read_bytes()), ribbon, cell.backend, cell.method)
