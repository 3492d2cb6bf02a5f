"""Running a plan from the command line: progress on stderr, tables and pictures at the end."""

from __future__ import annotations

import signal
from types import FrameType
from typing import TYPE_CHECKING

import typer

from causalbench.cli.options import EXIT_INTERRUPTED

if TYPE_CHECKING:
    from causalbench.run.session import Execution
    from causalbench.store.run_folder import RunFolder
    from causalbench.suite.plan import Plan
    from causalbench.suite.schema import SuiteFile


def _interrupt(number: int, frame: FrameType | None) -> None:
    """What schedulers send is what Ctrl-C is."""
    raise KeyboardInterrupt


def execute(plan: Plan, folder: RunFolder, file: SuiteFile, execution: Execution, quiet: bool) -> None:
    """Run what `plan` lacks in `folder` and write its tables and report. Raises `typer.Exit` when it is interrupted."""
    from causalbench.cli.progress import choose_view
    from causalbench.cli.terminal_tables import print_problems, progress_console
    from causalbench.plugins.manager import installed
    from causalbench.run.session import run_plan
    from causalbench.running import write_all

    view = choose_view(quiet, progress_console())

    print_problems([folder])
    before = signal.signal(signal.SIGTERM, _interrupt)
    try:
        run_plan(plan, folder, file, installed(), execution, view, lambda: write_all(folder))
    except KeyboardInterrupt:
        typer.echo("stopped; the same command continues with what is missing", err=True)
        raise typer.Exit(EXIT_INTERRUPTED) from None
    finally:
        signal.signal(signal.SIGTERM, before)
