"""How numbers and names are written on the page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import pandas as pd

from causalbench.report.columns import COLUMNS
from causalbench.report.html.parts import Column, Value

NOTHING = Value("\N{EN DASH}")


def records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows of `frame`; None for a missing value."""
    plain = frame.astype(object)
    return [
        {str(key): value for key, value in row.items()} for row in plain.where(plain.notna(), None).to_dict("records")
    ]


def entry(row: Any) -> str:
    """What the page calls a method at a point of a grid."""
    return f"{row['method']} ({row['grid_point']})" if row["grid_point"] else str(row["method"])


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


def present(values: Sequence[Any]) -> list[Any]:
    """Those that are not missing."""
    return [value for value in values if value is not None]
