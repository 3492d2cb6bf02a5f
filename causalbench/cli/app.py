"""The command line. Commands import what they need when they run, so that `--help` is quick and imports no torch."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from causalbench._version import __version__
from causalbench.cli.backends import backends, check, doctor, new_backend
from causalbench.cli.discover import discover
from causalbench.cli.options import EXIT_FAILED, EXIT_MISTAKE
from causalbench.cli.results import leaderboard, play, report, verify
from causalbench.cli.run import plan, run
from causalbench.errors import CausalbenchError, UserError

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
for command in (run, plan, discover, leaderboard, report, play, verify, backends, check, new_backend, doctor):
    app.command()(command)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"causalbench {__version__}")
        raise typer.Exit


Version = Annotated[bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")]


@app.callback()
def causalbench(version: Version = False) -> None:
    """Does knowing which actions cause which rewards make multi-stage robot tasks learnable, in any simulator?"""


def main() -> None:
    """The command `causalbench`: a user's mistake is one message and exit code 2, never a traceback."""
    try:
        app()
    except UserError as error:
        typer.echo(f"error: {error}", err=True)
        sys.exit(EXIT_MISTAKE)
    except CausalbenchError as error:
        typer.echo(f"failed: {error}", err=True)
        sys.exit(EXIT_FAILED)
