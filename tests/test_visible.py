"""What others have written is shown on a terminal, never obeyed by it."""

from __future__ import annotations

import io

import pytest
from rich.table import Table

from causalbench.cli.visible import VisibleConsole, visible


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        ("a\x1b[31mb", r"a\x1b[31mb"),
        ("\x1b]0;title\x07", r"\x1b]0;title\x07"),
        ("a\rb\x08", r"a\rb\x08"),
        ("\x9b2J", r"\x9b2J"),
        ("abc\u202edef", r"abc\u202edef"),
        ("\u200b", r"\u200b"),
        ("two\nlines\tü 日本", "two\nlines\tü 日本"),
    ],
)
def test_what_a_terminal_would_act_on_is_an_escape(given: str, shown: str) -> None:
    assert visible(given) == shown
    out = io.StringIO()
    console = VisibleConsole(file=out, force_terminal=True, width=100)
    table = Table(given)
    table.add_row(given)
    console.print(given, markup=False, highlight=False)
    console.print(table)
    assert out.getvalue().count(shown.splitlines()[0]) == 3
    assert "\x1b]0" not in out.getvalue()
    assert "\x1b[2J" not in out.getvalue()
