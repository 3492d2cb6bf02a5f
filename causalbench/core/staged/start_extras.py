"""Named numbers of starts, which facts carry along for the task that drew them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from causalbench.core.world.batch import stack_extras
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout
from causalbench.errors import UserError

Array = NDArray[np.float64]


def start_extras(layouts: Sequence[Layout | None]) -> dict[str, Array]:
    """`Layout.extras` (n, ...) of n starts, read-only; NaN for a world that has none yet (None).

    Raises `CausalbenchError` unless all have the same names and shapes.
    """
    known = [layout.extras for layout in layouts if layout is not None]
    if not any(known):
        return {}
    missing = {name: np.full(np.shape(value), np.nan) for name, value in known[0].items()}
    found = stack_extras([missing if layout is None else layout.extras for layout in layouts])
    for value in found.values():
        value.flags.writeable = False
    return found


def with_extras(facts: Facts, extras: Mapping[str, Array]) -> Facts:
    """`facts` with `extras` beside its own. Raises `UserError` for a name that both have."""
    if not extras:
        return facts
    if both := facts.extras.keys() & extras.keys():
        raise UserError(f"extras {sorted(both)}: the scene has numbers of these names; call the layout's otherwise")
    return dataclasses.replace(facts, extras={**facts.extras, **extras})
