"""Budgets in one run folder: cells of a smaller one than the largest on their backend are kept, and in no table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

Identity = Mapping[str, Any]


def largest_budgets(identities: Iterable[Identity]) -> dict[str, int]:
    """Backend -> the largest budget, in env steps, of a learner cell on it."""
    found: dict[str, int] = {}
    for identity in identities:
        name = identity["backend"]["name"]
        found[name] = max(found.get(name, 0), identity.get("env_steps", 0))
    return found


def is_outgrown(identity: Identity, largest: Mapping[str, int]) -> bool:
    """Whether it is a learner cell with a smaller budget than `largest` has for its backend."""
    return identity.get("env_steps", 0) < largest.get(identity["backend"]["name"], 0) and identity["kind"] == "learner"


def but_budget(identity: Identity) -> dict[str, Any]:
    """What a cell shares with that of another budget which it may go on from."""
    return {key: value for key, value in identity.items() if key != "env_steps"}
