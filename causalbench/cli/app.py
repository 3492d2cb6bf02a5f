"""The command line. Commands import what they need when they run, so that `--help` is quick and imports no torch."""

from __future__ import annotations

import errno
import os
import sys
import tempfile
import traceback
from typing import Annotated, NoReturn

import typer

from causalbench._version import __version__
from causalbench.cli.backends import backends, check, doctor, names, new_backend, new_task
from causalbench.cli.discover import discover
from causalbench.cli.options import EXIT_FAILED, EXIT_MISTAKE, EXIT_UNEXPECTED
from causalbench.cli.results import leaderboard, play, report, reversals, status, transfer, verify
from causalbench.cli.run import plan, run
from causalbench.errors import CausalbenchError, UserError
from causalbench.pages import page

EPILOG = f"Documentation: {page('index.md')}"
app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, epilog=EPILOG)
READERS = (status, leaderboard, report, play, reversals, transfer, verify)
for command in (run, plan, discover, *READERS, backends, names, check, new_backend, new_task, doctor):
    app.command()(command)

TRACEBACK = "CAUSALBENCH_TRACEBACK"
"""Environment variable: an unexpected error is raised with its traceback."""
OF_THE_MACHINE = {errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EPERM, errno.EROFS, errno.EMFILE, errno.ENAMETOOLONG}
"""Errors of the operating system that a person must mend: a full or a read-only disk and the like."""


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"causalbench {__version__}")
        raise typer.Exit


Version = Annotated[bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")]


@app.callback()
def causalbench(version: Version = False) -> None:
    """Does knowing which actions cause which rewards make multi-stage robot tasks learnable, in any simulator?"""


def main() -> None:
    """The command `causalbench`: whatever goes wrong is a sentence and an exit code, never a traceback."""
    try:
        app()
    except UserError as error:
        _end(EXIT_MISTAKE, f"error: {error}")
    except CausalbenchError as error:
        _end(EXIT_FAILED, f"failed: {error}")
    except Exception as error:
        if TRACEBACK in os.environ:
            raise
        if isinstance(error, OSError) and error.errno in OF_THE_MACHINE:
            _end(EXIT_FAILED, f"failed: {error.filename or 'a file'}: {error.strerror}")
        _end(
            EXIT_UNEXPECTED,
            f"unexpected {type(error).__name__}: {error}\nThis is a mistake in causalbench or in a plugin, not yours. "
            f"What led to it is in {_report()}; {TRACEBACK}=1 prints it instead",
        )


def _end(code: int, sentence: str) -> NoReturn:
    from causalbench.cli.visible import visible

    typer.echo(visible(sentence), err=True)
    sys.exit(code)


def _report() -> str:
    """A new file with the traceback of the exception that is being handled."""
    with tempfile.NamedTemporaryFile("w", prefix="causalbench-", suffix=".txt", delete=False) as file:
        file.write(f"{sys.orig_argv}\ncausalbench {__version__}\n{traceback.format_exc()}")
    return file.name
