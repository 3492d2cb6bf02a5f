"""What `--only` keeps of a plan or of a run."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from causalbench.errors import UnknownNameError, UserError

ItemT = TypeVar("ItemT", str, int)


@dataclass(frozen=True)
class Selection:
    """Names and seeds to keep; an empty set keeps everything."""

    backend: frozenset[str] = frozenset()
    method: frozenset[str] = frozenset()
    seed: frozenset[int] = frozenset()

    @classmethod
    def parse(cls, options: Iterable[str]) -> Selection:
        """From texts such as "backend=A,method=B,seed=0". Raises `UserError`."""
        found: dict[str, set[Any]] = {field.name: set() for field in dataclasses.fields(cls)}
        for part in (part.strip() for option in options for part in option.split(",")):
            key, equals, value = part.partition("=")
            if not equals or key not in found:
                raise UserError(f"--only {part!r}: expected backend=NAME, method=NAME or seed=NUMBER")
            if key == "seed" and not value.isdecimal():
                raise UserError(f"--only {part!r}: a seed is a number from 0")
            found[key].add(int(value) if key == "seed" else value)
        return cls(**{key: frozenset(values) for key, values in found.items()})

    def keeps(self, identity: Mapping[str, Any]) -> bool:
        """Whether a learner cell with this identity is kept."""
        found = (
            (self.backend, identity["backend"]["name"]),
            (self.method, identity["method"]["name"]),
            (self.seed, identity["seed"]),
        )
        return all(not wanted or value in wanted for wanted, value in found)


def choose(kind: str, available: Sequence[ItemT], wanted: frozenset[ItemT]) -> list[ItemT]:
    """Those of `available` that are wanted, all if none are named. Raises `UnknownNameError` for another name."""
    for name in sorted(wanted):
        if name not in available:
            raise UnknownNameError(f"{kind} in --only", str(name), map(str, available))
    return [item for item in available if not wanted or item in wanted]
