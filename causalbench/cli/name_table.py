"""What a suite may name, as a table."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from causalbench.cli.terminal_tables import print_content

if TYPE_CHECKING:
    from causalbench.core.learners.methods import Method
    from causalbench.plugins.manager import Plugins


def name_rows(plugins: Plugins) -> list[dict[str, str]]:
    """One row per registered name: its kind, what it is in a line, and the package that registered it."""
    abouts = {
        "task": {t.name: f"{t.n_stages} stages, actions {' '.join(t.actions)}" for t in plugins.tasks.values()},
        "method": {m.name: _about(m) for m in plugins.methods.values()},
        "learner": {learner.name: learner.about for learner in plugins.learners.values()},
        "discoverer": {discoverer.name: discoverer.about for discoverer in plugins.discoverers.values()},
    }
    return [
        {"kind": kind, "name": name, "about": found[name], "package": plugins.packages[f"{kind}s", name]}
        for kind, found in abouts.items()
        for name in sorted(found)
    ]


def _about(method: Method) -> str:
    parts = [f"{method.learner}, {method.action_space} actions, {method.gradient} gradient, matrix: {method.matrix}"]
    parts += [f"discoverer: {method.discoverer}"] if method.discoverer else []
    parts += [f"control: {method.control}"] if method.control != "none" else []
    return "; ".join([*parts, "cooperating stages"] if method.cooperation else parts)


def print_names(rows: Iterable[dict[str, str]]) -> None:
    """The rows of `name_rows`."""
    table = Table("kind", "name", "about", "package")
    for row in rows:
        table.add_row(*map(escape, row.values()))
    print_content(table)
