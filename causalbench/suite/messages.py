"""What is wrong with a suite file, in words."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable
from typing import Any

import pydantic
from pydantic_core import ErrorDetails


def as_json(content: Any) -> str:
    """Data from YAML as the JSON that it means, for a strict reading: in JSON a list may be a tuple."""
    return json.dumps(content, default=str)


def worst(error: pydantic.ValidationError) -> ErrorDetails:
    """The mistake to name: a misspelt key also makes the right one missing."""
    return min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")


def explain(error: ErrorDetails, known: Iterable[str] = ()) -> str:
    """What is wrong in words; `known` are the keys that may stand beside the wrong one."""
    given, text = error["input"], error["msg"].replace("Input should", "should")
    if error["type"] == "extra_forbidden":
        return unknown_key(str(error["loc"][-1]), known)
    if error["type"] == "missing":
        return "this key is missing"
    if error["type"] == "literal_error":
        valid = [name.strip("'") for name in error["ctx"]["expected"].replace(" or ", ", ").split(", ")]
        return f"{text}, got {given!r}.{guess(str(given), valid)}"
    return f"{text}, got {given!r}"


def unknown_key(key: str, known: Iterable[str]) -> str:
    """The sentence for a key that is none of `known`."""
    known = list(known)
    return f"unknown key.{guess(key, known)} Known: {', '.join(known) or 'none'}"


def guess(name: str, known: Iterable[str]) -> str:
    """ " Did you mean 'x'?", or nothing if nothing is close."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f" Did you mean {close[0]!r}?" if close else ""
