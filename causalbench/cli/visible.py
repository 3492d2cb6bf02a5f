"""Text of others, such as names in a run folder from a stranger: shown on a terminal, never obeyed by it."""

from __future__ import annotations

import unicodedata
from typing import Any

from rich.console import Console
from rich.text import Text

OBEYED = ("Cc", "Cf", "Cs", "Zl", "Zp")
"""Unicode's categories of characters that a terminal acts on, or that hide or turn around what stands beside them."""


def visible(text: str) -> str:
    r"""`text` with every such character as its escape, such as `\x1b`; line breaks and tabs stay."""
    return "".join(_escaped(character) if _is_obeyed(character) else character for character in text)


def _is_obeyed(character: str) -> bool:
    return character not in "\n\t" and unicodedata.category(character) in OBEYED


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")


class VisibleConsole(Console):
    """rich's console, which makes all text that it is given visible first."""

    def render_str(self, text: str, **options: Any) -> Text:
        """As rich's."""
        return super().render_str(visible(text), **options)
