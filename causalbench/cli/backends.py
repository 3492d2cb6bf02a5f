"""Commands about simulators: `backends`, `check`, `new-backend`, `doctor`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from causalbench.cli.options import EXIT_FAILED, AsJson, BackendOptions, Jobs, named_values, print_json
from causalbench.processes import cores


def backends() -> None:
    """List simulators, and plugins that could not be loaded."""
    from causalbench.cli.terminal_tables import print_backends
    from causalbench.plugins.manager import installed

    print_backends(installed())


def check(
    backend: Annotated[str, typer.Argument(help="Registered name, such as kinematic.")],
    option: BackendOptions = None,
    as_json: AsJson = False,
) -> None:
    """Check a backend against the numbered contract of docs/conformance.md."""
    from causalbench.cli.terminal_tables import print_checks
    from causalbench.conformance.suite import FAIL, run_checks
    from causalbench.plugins.manager import installed

    results = run_checks(installed().backend(backend), named_values(option or (), "--option", "control_hz=20"))
    if as_json:
        rows = list(map(vars, results))
        print_json({"backend": backend, "checks": rows})
    else:
        rows = print_checks(backend, map(vars, results))
    if any(row["outcome"] == FAIL for row in rows):
        raise typer.Exit(EXIT_FAILED)


def new_backend(
    name: Annotated[str, typer.Argument(help="Name to register, such as my_sim.")],
    out: Annotated[Path, typer.Option(help="Where the new folder NAME_backend goes.")] = Path(),
) -> None:
    """Write a plugin that passes `check`, for you to put your simulator into."""
    from causalbench.scaffold import write_backend

    folder = write_backend(name, out)
    typer.echo(f"wrote {folder}; now: pip install -e {folder} && causalbench check {name}, then {folder}/README.md")


def doctor(jobs: Jobs = None) -> None:
    """Try every simulator and look for what makes runs fail or crawl; exit code 1 if anything needs mending."""
    from causalbench.cli.terminal_tables import print_finding
    from causalbench.plugins.manager import installed
    from causalbench.run.doctor import examine

    found = []
    for finding in examine(installed(), jobs or cores()):
        print_finding(finding)
        found.append(finding.ok)
    if not all(found):
        raise typer.Exit(EXIT_FAILED)
