"""Commands that read run folders: `status`, `leaderboard`, `report`, `play`, `reversals`, `transfer`, `verify`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from causalbench.cli.options import EXIT_FAILED, AsJson, Jobs, Only, print_json
from causalbench.cli.visible import visible
from causalbench.processes import cores, use_one_thread_each

if TYPE_CHECKING:
    from causalbench.store.run_folder import RunFolder


def leaderboard(
    runs: Annotated[list[Path], typer.Argument(help="One or more run folders, ranked together.")],
    as_json: AsJson = False,
) -> None:
    """Print the verdicts and the leaderboard of one run, or of several that can be compared."""
    from causalbench.cli.terminal_tables import print_hypotheses, print_known_gaps, print_leaderboard, print_problems
    from causalbench.report.tables import merged_boards
    from causalbench.store.run_folder import RunFolder

    folders = [RunFolder(path) for path in runs]
    print_problems(folders)
    verdicts, rows = merged_boards(folders)
    if as_json:
        print_json({"verdicts": verdicts, "leaderboard": rows})
    else:
        print_hypotheses(verdicts)
        print_leaderboard(rows)
        print_known_gaps(folders)


def status(
    run: Annotated[Path, typer.Argument(help="Run folder, also of a run in another process or on another node.")],
    as_json: AsJson = False,
) -> None:
    """Say how far a run is, which cells are left or failed, and which process works on it."""
    import dataclasses

    from causalbench.cli.terminal_tables import print_problems, print_status
    from causalbench.run.watch import run_status
    from causalbench.store.run_folder import RunFolder

    print_problems([RunFolder(run)])
    found = run_status(RunFolder(run))
    if as_json:
        print_json(dataclasses.asdict(found))
    else:
        print_status(found)


def report(
    run: Annotated[Path, typer.Argument(help="Run folder.")],
    out: Annotated[Path | None, typer.Option(help="Write only the page, to this file.")] = None,
) -> None:
    """Write report.html, one page with all results of a run, which a browser opens from disk."""
    from causalbench.cli.terminal_tables import print_problems
    from causalbench.report.html.page import write_report
    from causalbench.store.run_folder import RunFolder

    print_problems([RunFolder(run)])
    typer.echo(visible(str(write_report(run, out))))


def play(
    run: Annotated[Path, typer.Argument(help="Run folder.")],
    only: Only = None,
    episodes: Annotated[int, typer.Option(min=1, help="Episodes of each policy.")] = 1,
) -> None:
    """Make films of the trained policies of a run, videos/*.mp4 in its folder; `report` then shows them."""
    from causalbench.cli.terminal_tables import print_problems
    from causalbench.run.play import play
    from causalbench.store.run_folder import RunFolder

    folder = RunFolder(run)
    print_problems([folder])
    for path in play(folder, only or (), episodes):
        typer.echo(visible(str(path)))


def reversals(
    run: Annotated[Path, typer.Argument(help="Run folder.")],
    only: Only = None,
    episodes: Annotated[
        int, typer.Option(min=1, help="Episodes of each policy: so many deterministic, and so many sampled.")
    ] = 20,
) -> None:
    """Repeat every reversal without some actions, to see which caused it: reversals.csv; `report` then shows it."""
    from causalbench.run.reversals import account_for_reversals

    _say(run, lambda folder: account_for_reversals(folder, only or (), episodes))


def transfer(
    run: Annotated[Path, typer.Argument(help="Run folder.")],
    only: Only = None,
    episodes: Annotated[
        int, typer.Option(min=1, help="Episodes of each policy: so many deterministic, and so many sampled.")
    ] = 20,
) -> None:
    """Play every policy on the other backends of its run: transfer.csv; `report` then shows it."""
    from causalbench.run.transfer import play_elsewhere

    _say(run, lambda folder: play_elsewhere(folder, only or (), episodes))


def _say(run: Path, work: Callable[[RunFolder], Iterator[str]]) -> None:
    """Print the sentences of `work`, which writes tables beside cells, and write the run's tables anew."""
    from causalbench.cli.terminal_tables import print_problems
    from causalbench.report.tables import write_tables
    from causalbench.store.run_folder import RunFolder

    folder = RunFolder(run)
    print_problems([folder])
    for sentence in work(folder):
        typer.echo(visible(sentence))
    write_tables(folder)


def verify(
    run: Annotated[Path, typer.Argument(help="Run folder.")],
    cells: Annotated[int, typer.Option(min=1, help="How many finished cells to run again.")] = 2,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random choice of cells.")] = 0,
    jobs: Jobs = None,
    as_json: AsJson = False,
    quiet: Annotated[bool, typer.Option(help="Show no progress.")] = False,
) -> None:
    """Run a few random cells of a run again, and say whether the results are the same to the bit."""
    use_one_thread_each()
    import dataclasses

    from causalbench.cli.progress import choose_view
    from causalbench.cli.terminal_tables import print_problems, print_verdicts, progress_console
    from causalbench.plugins.manager import installed
    from causalbench.run.verify import verify as verified
    from causalbench.store.run_folder import RunFolder

    folder = RunFolder(run)
    print_problems([folder])
    view = choose_view(quiet or as_json, progress_console())
    verdicts, changes = verified(folder, installed(), cells, seed, jobs or cores(), view)
    if as_json:
        print_json({"cells": [dataclasses.asdict(verdict) for verdict in verdicts], "changed": changes})
    else:
        print_verdicts(verdicts, changes)
    if not all(verdict.agrees for verdict in verdicts):
        raise typer.Exit(EXIT_FAILED)
