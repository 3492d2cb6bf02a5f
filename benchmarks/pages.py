"""Pages of docs whose tables are made from docs/data, each between `<!-- table: NAME -->` and `<!-- end -->`."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pandas as pd

from causalbench.atomic import write_text

DOCS = Path("docs/data")
MARK = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
Frames = Mapping[str, pd.DataFrame]
"""Every file of docs/data by its name without `.csv`."""
Tables = Mapping[str, tuple[Callable[[Frames], pd.DataFrame], tuple[str, ...]]]
"""By name of a table: what draws it, and the files it needs; one that is not there is "not measured"."""


def merged(path: Path, new: pd.DataFrame, keys: Sequence[str]) -> pd.DataFrame:
    """`new` and the rows that `path` has of other `keys`, by `keys`: what is not measured again keeps its rows."""
    keys = list(keys)
    if path.exists():
        old = pd.read_csv(path)
        known = set(map(tuple, new[keys].to_numpy()))
        new = pd.concat([new, old[[tuple(key) not in known for key in old[keys].to_numpy()]]])
    return new.sort_values(keys, kind="stable", ignore_index=True)


def write(path: Path, table: pd.DataFrame) -> None:
    """A table as CSV."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, table.to_csv(index=False, lineterminator="\n", float_format="%.6g"))


def merge_into(path: Path, new: pd.DataFrame, keys: Sequence[str]) -> None:
    """Replace the rows of `path` that have the same `keys` as rows of `new`."""
    write(path, merged(path, new, keys))


def rounded(table: pd.DataFrame, **digits: int) -> pd.DataFrame:
    """Numbers as text with so many digits; a missing one is empty."""
    out = table.copy()
    for column, n in digits.items():
        out[column] = [f"{v:,.{n}f}" if pd.notna(v) else "" for v in table[column]]
    return out


def markdown(table: pd.DataFrame) -> str:
    """A table of the page."""
    lines = [table.columns, ["---"] * len(table.columns), *table.astype(str).to_numpy()]
    return "".join(f"| {' | '.join(str(cell).replace('|', '/') for cell in line)} |\n" for line in lines)


def filled(page: str, tables: Tables, docs: Path) -> str:
    """The page with every table renewed."""
    frames = {path.stem: pd.read_csv(path) for path in docs.glob("*.csv")}

    def renew(match: re.Match[str]) -> str:
        draw, needs = tables[match[2]]
        missing = [name for name in needs if name not in frames]
        text = f"Not measured: docs/data/{missing[0]}.csv is not there.\n" if missing else markdown(draw(frames))
        return f"{match[1]}\n{text}\n{match[3]}"

    return MARK.sub(renew, page)


def arguments(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """The arguments, `--check` and `--docs` among them."""
    parser.add_argument("--check", action="store_true", help="fail if the page says something else")
    parser.add_argument("--docs", type=Path, default=DOCS)
    return parser.parse_args()


def renew(page: Path, tables: Tables, args: argparse.Namespace) -> None:
    """Write the tables into `page` or, with `--check`, end the program with a sentence if they are others."""
    text = page.read_text(encoding="utf-8")
    new = filled(text, tables, args.docs)
    if args.check:
        sys.exit(f"{page}: its tables are not those of {args.docs}" if new != text else 0)
    page.write_text(new, encoding="utf-8")
