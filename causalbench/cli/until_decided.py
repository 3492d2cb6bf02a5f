"""`causalbench run --until-decided`: seeds are added from look to look until every hypothesis is decided."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import typer

from causalbench.cli.execution import execute
from causalbench.errors import UserError

if TYPE_CHECKING:
    from causalbench.run.session import Execution
    from causalbench.store.run_folder import RunFolder
    from causalbench.suite.plan import Plan
    from causalbench.suite.schema import SuiteFile


def execute_until_decided(plan: Plan, folder: RunFolder, file: SuiteFile, execution: Execution, quiet: bool) -> Plan:
    """Run `plan` look by look, saying why it goes on or stops; the part of it that was run.

    Raises `UserError` for a suite without hypotheses.
    """
    from causalbench.report.sequential import with_looks

    if not plan.statement.hypotheses:
        raise UserError("--until-decided: this suite states no hypotheses; add `hypotheses: [A > B]`")
    plan = replace(plan, statement=with_looks(plan.statement))
    for number, seeds in enumerate(plan.statement.looks, start=1):
        part = plan.up_to(seeds)
        execute(part, folder, file, execution, quiet)
        if _stops(folder, part, number):
            break
    return part


def _stops(folder: RunFolder, plan: Plan, number: int) -> bool:
    from causalbench.report.sequential import look_rows
    from causalbench.report.tables import result_rows
    from causalbench.store.statements import Stated

    cells = folder.cells()
    rows = look_rows(result_rows(cells), cells, [Stated(plan.statement, before_any_cell=True)])
    found = next(row for row in rows if row["look"] == number)
    typer.echo(f"Look {number}, {found['spent']} seeds: {found['reason']}.", err=True)
    return bool(found["stops"])
