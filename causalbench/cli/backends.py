"""Commands about simulators and tasks: `backends`, `check`, `new-backend`, `new-task`, `doctor`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from causalbench.cli.options import EXIT_FAILED, AsJson, BackendOptions, Jobs, named_values, print_json
from causalbench.errors import UserError
from causalbench.processes import cores

if TYPE_CHECKING:
    from causalbench.conformance.check import Result


def backends() -> None:
    """List simulators, and plugins that could not be loaded."""
    from causalbench.cli.terminal_tables import print_backends
    from causalbench.plugins.manager import installed

    print_backends(installed())


def names(as_json: AsJson = False) -> None:
    """List every task, method, learner and discoverer that a suite may name, with the package that it comes from."""
    from causalbench.cli.name_table import name_rows, print_names
    from causalbench.plugins.manager import installed

    rows = name_rows(installed())
    if as_json:
        print_json(rows)
    else:
        print_names(rows)


def check(
    backend: Annotated[str | None, typer.Argument(help="Registered name of a backend, such as kinematic.")] = None,
    task: Annotated[str | None, typer.Option(help="Check this task instead of a backend.")] = None,
    where: Annotated[
        str | None, typer.Option("--backend", help="Backend in which to check the task (default: its own).")
    ] = None,
    option: BackendOptions = None,
    as_json: AsJson = False,
) -> None:
    """Check a backend, or a task, against its numbered contract (docs/conformance.md, docs/task_conformance.md)."""
    from causalbench.cli.terminal_tables import print_checks
    from causalbench.conformance.check import FAIL

    subject, results = _checks(backend, task, where, named_values(option or (), "--option", "control_hz=20"))
    if as_json:
        rows = list(map(vars, results))
        print_json(subject | {"checks": rows})
    else:
        rows = print_checks(" in ".join(subject.values()), map(vars, results))
    if any(row["outcome"] == FAIL for row in rows):
        raise typer.Exit(EXIT_FAILED)


def _checks(
    backend: str | None, task: str | None, where: str | None, options: dict[str, Any]
) -> tuple[dict[str, str], Iterator[Result]]:
    """What is checked, by kind and name, and the results of it."""
    from causalbench.conformance.suite import run_checks
    from causalbench.conformance.task_suite import run_task_checks
    from causalbench.plugins.manager import installed
    from causalbench.plugins.venues import venue_of

    plugins = installed()
    if task is not None and backend is None:
        chosen = plugins.task(task)
        place = plugins.backend(where or venue_of(chosen).home)
        return {"task": task, "backend": place.name}, run_task_checks(chosen, place, options)
    if backend is None or task is not None or where is not None:
        raise UserError("expected the name of a backend, or --task NAME and, where it is to be played, --backend NAME")
    return {"backend": backend}, run_checks(plugins.backend(backend), options)


def new_backend(
    name: Annotated[str, typer.Argument(help="Name to register, such as my_sim.")],
    out: Annotated[Path, typer.Option(help="Where the new folder NAME_backend goes.")] = Path(),
) -> None:
    """Write a plugin for a simulator of yours: a toy world that passes `check`, to be replaced part by part."""
    from causalbench.scaffold import write_backend

    folder = write_backend(name, out)
    typer.echo(f"wrote {folder}; now: pip install -e {folder} && causalbench check {name}, then {folder}/README.md")


def new_task(
    name: Annotated[str, typer.Argument(help="Name to register, such as my_task.")],
    out: Annotated[Path, typer.Option(help="Where the new folder NAME_task goes.")] = Path(),
) -> None:
    """Write a task over a Gymnasium environment of yours: a pendulum that passes `check`, to be replaced."""
    from causalbench.scaffold import write_task

    folder = write_task(name, out)
    typer.echo(
        f"wrote {folder}; now: pip install -e {folder} && causalbench check --task {name}, then {folder}/README.md"
    )


def doctor(jobs: Jobs = None) -> None:
    """Try every simulator and look for what makes runs fail or slow; the exit code is 1 if there is anything."""
    from causalbench.cli.terminal_tables import print_finding
    from causalbench.plugins.manager import installed
    from causalbench.run.doctor import examine

    found = []
    for finding in examine(installed(), jobs or cores()):
        print_finding(finding)
        found.append(finding.ok)
    if not all(found):
        raise typer.Exit(EXIT_FAILED)
