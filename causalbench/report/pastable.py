"""The leaderboard to paste: `leaderboard.md` and `leaderboard.tex`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pandas as pd

from causalbench.report.frames import records
from causalbench.report.leaderboard import at_point

HEADINGS = (
    "backend",
    "rank",
    "method",
    "seeds",
    "success AUC (IQM)",
    "final success",
    "steps to 90%",
    "with discovery",
    "verdict",
)
NUMERIC = (False, True, False, True, True, True, True, True, False)
LATEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}",
}  # fmt: skip


def leaderboard_md(board: pd.DataFrame) -> str:
    """A table in GitHub's Markdown; rows of `leaderboard.csv`."""
    rule = ["---:" if numeric else "---" for numeric in NUMERIC]
    lines = [_md_row(HEADINGS, markdown), _md_row(rule, str), *(_md_row(row, markdown) for row in _rows(board))]
    return "\n".join(lines) + "\n"


def leaderboard_tex(board: pd.DataFrame) -> str:
    """A tabular with the rules of booktabs; rows of `leaderboard.csv`."""
    align = "".join("r" if numeric else "l" for numeric in NUMERIC)
    rows = [" & ".join(map(latex, row)) + r" \\" for row in _rows(board)]
    head = " & ".join(map(latex, HEADINGS)) + r" \\"
    lines = [
        "% \\usepackage{booktabs}",
        rf"\begin{{tabular}}{{{align}}}",
        r"\toprule",
        head,
        r"\midrule",
        *rows,
        r"\bottomrule",
    ]
    return "\n".join([*lines, r"\end{tabular}"]) + "\n"


def markdown(text: str) -> str:
    """`text` as it stands in a cell of a Markdown table."""
    return re.sub(r"([\\`*_{}\[\]<>()#+!|~&-])", r"\\\1", " ".join(text.split()))


def latex(text: str) -> str:
    """`text` as it stands in a LaTeX document."""
    return "".join(LATEX.get(letter, letter) for letter in " ".join(text.split()))


def _md_row(cells: Sequence[str], escape: Callable[[str], str]) -> str:
    return f"| {' | '.join(map(escape, cells))} |"


def _rows(board: pd.DataFrame) -> list[list[str]]:
    return [_row(row) for row in records(board)]


def _row(row: Mapping[Any, Any]) -> list[str]:
    area = _number(row["success_auc_iqm"], ".3f")
    if row["success_auc_lowest"] is not None:
        area += f" [{row['success_auc_lowest']:.3f}, {row['success_auc_highest']:.3f}]"
    steps = [_steps(row, name) for name in ("steps_to_90", "steps_to_90_with_discovery")]
    success = _number(row["success_deterministic"], ".2f")
    return [
        row["backend"],
        _number(row["rank"], "d"),
        at_point(row["method"], row["grid_point"]),
        _number(row["seeds"], "d"),
        area,
        success,
        *steps,
        row["verdict"] or "",
    ]


def _steps(row: Mapping[Any, Any], name: str) -> str:
    never = row[name] is None and row["budget"] is not None
    return f">{row['budget']}" if never else _number(row[name], ".0f")


def _number(value: Any, form: str) -> str:
    return "" if value is None else format(value, form)
