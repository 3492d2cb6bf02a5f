"""The settings sections of a suite: what may stand in `learner`, `discovery` and `evaluation`.

They are built from what plugins registered: a settings record's fields, their types and bounds are its keys here.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_type_hints

import pydantic
from pydantic import ConfigDict, TypeAdapter
from typing_extensions import TypedDict

from causalbench.core.discovery.registry import Discoverer
from causalbench.core.discovery.settings import PRESETS as DISCOVERY_PRESETS
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.learners.registry import Learner
from causalbench.core.learners.settings import EvaluationSettings
from causalbench.errors import UnknownNameError
from causalbench.plugins.manager import Plugins
from causalbench.suite.messages import as_json, explain, unknown_key, worst
from causalbench.suite.positions import Location

Patch = Mapping[str, Any]
"""Some settings by name, as they stand in the file; of several patches the last one wins, key by key."""
Problem = tuple[Location, str]
"""Where inside a patch something is wrong, and what."""

PRESET = "preset"
SECTIONS = ("learner", "discovery", "evaluation")


@dataclass(frozen=True)
class Record:
    """The keys of one settings dataclass, and `preset` where there are any."""

    settings: type[Any]
    presets: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()  # fields that are no keys

    @cached_property
    def hints(self) -> dict[str, Any]:
        """Key -> its type, bounds included."""
        found = {PRESET: Literal[self.presets]} if self.presets else {}
        return found | {
            name: hint
            for name, hint in get_type_hints(self.settings, include_extras=True).items()
            if name not in self.left_out
        }

    @cached_property
    def _adapter(self) -> TypeAdapter[dict[str, Any]]:
        make: Any = TypedDict  # mypy knows those of the source alone
        patch = make("patch", self.hints, total=False)
        patch.__pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)
        return TypeAdapter(patch)

    def parse(self, patch: Patch) -> dict[str, Any]:
        """`patch` in the types of the record. Raises `pydantic.ValidationError`."""
        return self._adapter.validate_json(as_json(patch), strict=True)

    def problem(self, patch: Patch) -> Problem | None:
        """The first mistake in `patch`, None if there is none."""
        try:
            self.parse(patch)
        except pydantic.ValidationError as error:
            first = worst(error)
            return first["loc"], explain(first, self.hints)
        return None

    def resolve(self, patches: Iterable[Patch]) -> Any:
        """The record's defaults after `patches`."""
        return self.settings(**self.parse({key: value for patch in patches for key, value in patch.items()}))


@dataclass(frozen=True)
class LearnerSection:
    """`learner`: each key goes to every learner of the suite's methods that has it, a section `NAME:` to that one.

    Keys of a section win over those beside it. A preset goes to the learners that have one of that name.
    """

    learners: Mapping[str, Learner]  # those of the suite's methods
    others: Mapping[str, Learner]

    @property
    def _rows(self) -> dict[str, Learner]:
        return {**self.learners, **self.others}

    @cached_property
    def records(self) -> dict[str, Record]:
        """By learner, of this suite or not, the keys of its section."""
        return {name: Record(row.settings, tuple(row.presets)) for name, row in self._rows.items()}

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """Every key that reaches a learner of this suite."""
        return (*dict.fromkeys(key for name in self.learners for key in self.records[name].hints), *self.learners)

    def owners(self, key: str) -> list[str]:
        """The learners, of this suite or not, that a key reaches."""
        return [name for name, record in self.records.items() if key == name or key in record.hints]

    def problem(self, patch: Patch, methods: Mapping[str, str]) -> Problem | None:
        """The first mistake in `patch`, None if there is none; it is for `methods`, given with the learner of each."""
        reached = dict.fromkeys(methods.values())
        for key, value in patch.items():
            owners = self.owners(key)
            if not owners:
                return (key,), unknown_key(key, self.keys)
            here = [name for name in owners if name in reached]
            if not here:
                return (key,), _useless(owners, list(methods))
            records = [self.records[name] for name in here]
            if key == PRESET:  # a learner that lacks it keeps its defaults
                presets = dict.fromkeys(preset for record in records for preset in record.presets)
                records = [dataclasses.replace(records[0], presets=tuple(presets))]
            problems = [_inside(key, value, r) if key in here else r.problem({key: value}) for r in records]
            if found := next(filter(None, problems), None):
                return found
        return None

    def reaches(self, key: str, subject: str) -> bool:
        """Whether the dotted `key` is a setting of the learner `subject`."""
        name, dot, _ = key.partition(".")
        return name == subject if dot else name in self.records[subject].hints

    def resolve(self, learner: str, patches: Iterable[Patch]) -> Any:
        """The settings of `learner` after `patches`, from the last preset that is named or the defaults."""
        record, row = self.records[learner], self._rows[learner]
        merged: dict[str, Any] = {}
        for patch in patches:
            merged |= {key: value for key, value in patch.items() if key in record.hints} | patch.get(learner, {})
        start = row.presets.get(merged.pop(PRESET, ""), row.settings())
        return dataclasses.replace(start, **record.parse(merged))


@dataclass(frozen=True)
class DiscoverySection:
    """`discovery`: the settings that all discoverers share, and a section `NAME:` for each one's own.

    A preset is taken from the shared ones and from the discoverer's own of that name.
    """

    discoverers: Mapping[str, Discoverer]

    @cached_property
    def shared(self) -> Record:
        """The keys that are for any discoverer."""
        own = (preset for row in self.discoverers.values() for preset in row.presets)
        return Record(DiscoverySettings, tuple(dict.fromkeys([*DISCOVERY_PRESETS, *own])), ("options",))

    @cached_property
    def own(self) -> dict[str, Record]:
        """By discoverer the keys of its section."""
        return {name: Record(row.settings) for name, row in self.discoverers.items()}

    def problem(self, patch: Patch) -> Problem | None:
        """The first mistake in `patch`, None if there is none."""
        for key, value in patch.items():
            found: Problem | None
            if key in self.own:
                found = _inside(key, value, self.own[key])
            elif key == "discoverer" and isinstance(value, str) and value not in self.own:
                found = (key,), str(UnknownNameError("discoverer", value, self.own))
            elif key in self.shared.hints:
                found = self.shared.problem({key: value})
            else:
                found = (key,), unknown_key(key, (*self.shared.hints, *self.own))
            if found:
                return found
        return None

    def reaches(self, key: str, subject: str) -> bool:
        """Whether the dotted `key` is a setting of the discoverer `subject`."""
        name, dot, _ = key.partition(".")
        return name == subject if dot else name not in self.own or name == subject

    def resolve(self, patches: Iterable[Patch]) -> DiscoverySettings:
        """The settings after `patches`.

        Raises `UnknownNameError` for a discoverer that does not exist, `UserError` for a preset that it lacks.
        """
        shared: dict[str, Any] = {}
        own: dict[str, dict[str, Any]] = {name: {} for name in self.own}
        for patch in patches:
            shared |= {key: value for key, value in patch.items() if key not in own}
            for name in own:
                own[name] |= patch.get(name, {})
        shared = self.shared.parse(shared)
        name = shared.pop("discoverer", DiscoverySettings().discoverer)
        if name not in self.own:
            raise UnknownNameError("discoverer", name, self.own)
        options = self.own[name].parse(own[name])
        return self.discoverers[name].configure(shared.pop(PRESET, "quick"), shared, options)


@dataclass(frozen=True)
class Sections:
    """All settings sections of one suite."""

    learner: LearnerSection
    discovery: DiscoverySection
    evaluation: Record

    @classmethod
    def of(cls, plugins: Plugins, learners: Iterable[str]) -> Sections:
        """Those of a suite whose methods use `learners`."""
        used = {name: plugins.learners[name] for name in learners}
        others = {name: row for name, row in plugins.learners.items() if name not in used}
        return cls(LearnerSection(used, others), DiscoverySection(plugins.discoverers), Record(EvaluationSettings))

    def problem(self, section: str, patch: Patch, methods: Mapping[str, str]) -> Problem | None:
        """The first mistake in a `patch` of the named section, for `methods`, given with the learner of each."""
        if section == "learner":
            return self.learner.problem(patch, methods)
        return self.discovery.problem(patch) if section == "discovery" else self.evaluation.problem(patch)


def _inside(key: str, value: Any, record: Record) -> Problem | None:
    """A problem of the section `key: value`, located from outside of it."""
    found = record.problem(value)
    return found and ((key, *found[0]), found[1])


def _useless(owners: list[str], methods: list[str]) -> str:
    if not methods:
        return f"a setting of {' and '.join(owners)} methods, and this suite has none"
    verb = "is" if len(methods) == 1 else "are"
    return (
        f"a setting of {' and '.join(owners)} methods, and {', '.join(methods)} {verb} none; "
        "leave it out, or add such a method"
    )
