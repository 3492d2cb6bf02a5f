"""What commands share: options, exit codes, output as JSON."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import typer

from causalbench.errors import UserError

EXIT_FAILED, EXIT_MISTAKE, EXIT_UNEXPECTED, EXIT_INTERRUPTED = 1, 2, 3, 130


SuiteArgument = Annotated[Path, typer.Argument(help="Suite file, or the name of one that comes along: pure_manip.")]
Tier = Annotated[str, typer.Option(help="How much to run: one of the suite's tiers.")]
Seeds = Annotated[int | None, typer.Option(min=1, help="Run N seeds instead of the tier's number.")]
Only = Annotated[list[str] | None, typer.Option(help="Keep some cells: backend=A,method=B,seed=0 (repeatable).")]
Out = Annotated[Path | None, typer.Option(help="Run folder (default: runs/<suite>-<tier>).")]
Jobs = Annotated[int | None, typer.Option(min=1, help="Cells at a time (default: one per core).")]
BackendOptions = Annotated[list[str] | None, typer.Option(help="Option of the backend: name=value (repeatable).")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]


def print_json(content: Any) -> None:
    """Print `content` as indented JSON on stdout."""
    import json

    typer.echo(json.dumps(content, indent=1))


def named_values(given: Iterable[str], flag: str, example: str) -> dict[str, Any]:
    """`["timestep=0.002"]`, values of the option `flag`, as keyword arguments.

    A value that is no number, true or false stays a string. Raises `UserError`.
    """
    import json

    options = {}
    for text in given:
        name, equals, value = text.partition("=")
        if not name or not equals:
            raise UserError(f"{flag} {text!r}: expected name=value, such as {example}")
        try:
            options[name] = json.loads(value)
        except ValueError:
            options[name] = value
    return options
