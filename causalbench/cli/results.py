"""Commands that read run folders: `leaderboard`, `play`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from causalbench.cli.options import AsJson, Only, print_json


def leaderboard(
    runs: Annotated[list[Path], typer.Argument(help="One or more run folders, ranked together.")],
    as_json: AsJson = False,
) -> None:
    """Print the leaderboard of one run, or of several that can be compared."""
    from causalbench.cli.terminal_tables import print_known_gaps, print_leaderboard, print_problems
    from causalbench.report.tables import merged_leaderboard
    from causalbench.store.run_folder import RunFolder

    folders = [RunFolder(path) for path in runs]
    print_problems(folders)
    rows = merged_leaderboard(folders)
    if as_json:
        print_json(rows)
    else:
        print_leaderboard(rows)
        print_known_gaps(folders)


def play(
    run: Annotated[Path, typer.Argument(help="Run folder.")],
    only: Only = None,
    episodes: Annotated[int, typer.Option(min=1, help="Episodes of each policy.")] = 1,
) -> None:
    """Film trained policies of a run: videos/*.mp4 in its folder."""
    from causalbench.cli.terminal_tables import print_problems
    from causalbench.run.play import play
    from causalbench.store.run_folder import RunFolder

    folder = RunFolder(run)
    print_problems([folder])
    for path in play(folder, only or (), episodes):
        typer.echo(path)
