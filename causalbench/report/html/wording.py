"""How numbers and names are written on the page."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pandas as pd

from causalbench.report.columns import COLUMNS
from causalbench.report.html.parts import Column, Value
from causalbench.report.leaderboard import at_point

NOTHING = Value("\N{EN DASH}")


def entry(row: Any) -> str:
    """What the page calls a method at a point of a grid."""
    return at_point(row["method"], row["grid_point"])


def by_entry(frame: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """The rows of `frame` by what the page calls their method at its point of a grid."""
    groups = frame.groupby(["method", "grid_point"])
    return {at_point(str(method), str(point)): own for (method, point), own in groups}


def number(value: float | None, digits: int = 3) -> Value:
    """A number; a whole one with spaces between thousands."""
    if value is None:
        return NOTHING
    return Value(
        f"{value:,.0f}".replace(",", "\N{NARROW NO-BREAK SPACE}") if digits == 0 else f"{value:.{digits}f}",
        float(value),
    )


def percent(value: float | None) -> Value:
    """A share of episodes."""
    return NOTHING if value is None else Value(f"{100 * value:.0f}%", float(value))


def text(value: Any) -> Value:
    """Words; they sort by themselves."""
    return NOTHING if value in (None, "") else Value(str(value), str(value))


def column(name: str, heading: str = "", numeric: bool = True) -> Column:
    """A column of the data dictionary under `heading`."""
    found = COLUMNS[name]
    unit = f" ({found.unit})" if found.unit else ""
    return Column(heading or name.replace("_", " "), f"{found.sentence}{unit}", numeric)


def count(n: int, one: str, many: str = "") -> str:
    """`n` things in words."""
    return f"{n} {one if n == 1 else many or one + 's'}"


def listed(names: Iterable[str]) -> str:
    """Names with commas."""
    return ", ".join(names)
