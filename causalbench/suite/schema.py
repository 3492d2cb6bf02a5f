"""The suite file: what may stand in it, and errors that name file, line, key and the nearest valid name."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_type_hints

import pydantic
from pydantic import BaseModel, ConfigDict, Field, PositiveInt
from pydantic_core import CoreSchema, ErrorDetails, core_schema

from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.registry import Discoverer
from causalbench.core.discovery.settings import PRESETS as DISCOVERY_PRESETS
from causalbench.core.discovery.settings import SHARED, DiscoverySettings
from causalbench.core.learners.registry import LEARNERS
from causalbench.core.learners.settings import EvaluationSettings
from causalbench.suite.positions import Location, PositionedYaml

TierName = Literal["smoke", "quick", "full"]
TIERS: tuple[str, ...] = get_args(TierName)


@dataclass(frozen=True)
class Patch:
    """Marks a mapping that replaces some fields of a settings record of core, after an optional `preset`.

    Names and types are read from the record, so that they are written once.
    """

    settings: type[Any]
    presets: Mapping[str, Any] = dataclasses.field(default_factory=dict, hash=False)

    @property
    def keys(self) -> tuple[str, ...]:
        """Every key that the mapping may have."""
        return (*(("preset",) if self.presets else ()), *(f.name for f in dataclasses.fields(self.settings)))

    def __get_pydantic_core_schema__(self, source: Any, handler: pydantic.GetCoreSchemaHandler) -> CoreSchema:
        """A typed dict, none of whose keys is required."""
        return core_schema.typed_dict_schema(self.fields(handler), extra_behavior="forbid")

    def fields(self, handler: pydantic.GetCoreSchemaHandler) -> dict[str, core_schema.TypedDictField]:
        """The schema of every key."""
        fields = {
            name: core_schema.typed_dict_field(handler.generate_schema(hint), required=False)
            for name, hint in get_type_hints(self.settings, include_extras=True).items()
        }
        if self.presets:
            names = core_schema.literal_schema(list(self.presets))
            fields["preset"] = core_schema.typed_dict_field(names, required=False)
        return fields

    def resolve(self, patches: Iterable[Mapping[str, Any]]) -> Any:
        """The settings after `patches`, the last one winning; they start from the last preset that is named."""
        merged: dict[str, Any] = {}
        for patch in patches:
            merged |= patch
        preset = self.presets.get(merged.pop("preset", "quick"))
        return dataclasses.replace(preset or self.settings(), **merged)


@dataclass(frozen=True)
class LearnerPatch:
    """Marks a `learner` mapping: each key goes to every learner that has it; a section `SAC` or `PPO` to that one.

    Keys of a section win over those beside it.
    """

    learners: Mapping[str, Patch] = dataclasses.field(hash=False)

    @property
    def keys(self) -> tuple[str, ...]:
        """Every key that the mapping may have."""
        return (*dict.fromkeys(key for patch in self.learners.values() for key in patch.keys), *self.learners)

    def __get_pydantic_core_schema__(self, source: Any, handler: pydantic.GetCoreSchemaHandler) -> CoreSchema:
        """A typed dict, none of whose keys is required."""
        fields: dict[str, core_schema.TypedDictField] = {}
        for patch in self.learners.values():
            fields = patch.fields(handler) | fields
        for name, patch in self.learners.items():
            section = core_schema.typed_dict_schema(patch.fields(handler), extra_behavior="forbid")
            fields[name] = core_schema.typed_dict_field(section, required=False)
        return core_schema.typed_dict_schema(fields, extra_behavior="forbid")

    def resolve(self, learner: str, patches: Iterable[Mapping[str, Any]]) -> Any:
        """The settings of `learner` after `patches`; see `Patch.resolve`."""
        own = self.learners[learner]
        parts = [({k: v for k, v in patch.items() if k in own.keys}, patch.get(learner, {})) for patch in patches]
        return own.resolve(part for pair in parts for part in pair)

    def owners(self, key: str) -> tuple[str, ...]:
        """The learners that a key of the mapping reaches."""
        return tuple(name for name, patch in self.learners.items() if key == name or key in patch.keys)


@dataclass(frozen=True)
class DiscoveryPatch:
    """Marks a `discovery` mapping: the settings that all discoverers share, and a section for each one's own."""

    discoverers: Mapping[str, Discoverer] = dataclasses.field(hash=False)

    @property
    def sections(self) -> dict[str, Patch]:
        """By name the own settings of every discoverer."""
        return {name: Patch(row.settings) for name, row in self.discoverers.items()}

    @property
    def presets(self) -> tuple[str, ...]:
        """Every preset that there is, of the shared settings or of a discoverer's own."""
        own = (preset for row in self.discoverers.values() for preset in row.presets)
        return tuple(dict.fromkeys([*DISCOVERY_PRESETS, *own]))

    @property
    def keys(self) -> tuple[str, ...]:
        """Every key that the mapping may have."""
        return ("preset", "discoverer", *SHARED, *self.discoverers)

    def __get_pydantic_core_schema__(self, source: Any, handler: pydantic.GetCoreSchemaHandler) -> CoreSchema:
        """A typed dict, none of whose keys is required."""
        fields = Patch(DiscoverySettings, dict.fromkeys(self.presets)).fields(handler)
        del fields["options"]
        for name, section in self.sections.items():
            own = core_schema.typed_dict_schema(section.fields(handler), extra_behavior="forbid")
            fields[name] = core_schema.typed_dict_field(own, required=False)
        return core_schema.typed_dict_schema(fields, extra_behavior="forbid")

    def resolve(self, patches: Iterable[Mapping[str, Any]]) -> DiscoverySettings:
        """The settings after `patches`, the last one winning, key by key also in a section."""
        shared: dict[str, Any] = {}
        own: dict[str, dict[str, Any]] = {name: {} for name in self.discoverers}
        for patch in patches:
            shared |= {key: value for key, value in patch.items() if key not in own}
            for name in own:
                own[name] |= patch.get(name, {})
        name = shared.get("discoverer", DiscoverySettings().discoverer)
        return self.discoverers[name].configure(shared.pop("preset", "quick"), shared, own[name])


LEARNER = LearnerPatch({name: Patch(row.settings, row.presets) for name, row in LEARNERS.items()})
EVALUATION = Patch(EvaluationSettings)
DISCOVERY = DiscoveryPatch(DISCOVERERS)
PATCHES: Mapping[str, Patch | LearnerPatch | DiscoveryPatch] = {
    "learner": LEARNER,
    "evaluation": EVALUATION,
    "discovery": DISCOVERY,
}


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    learner: Annotated[dict[str, Any], LEARNER] = {}
    evaluation: Annotated[dict[str, Any], EVALUATION] = {}


class Tier(_Model):
    """How much to run: seeds 0 to `seeds` - 1, `env_steps` of training each."""

    seeds: PositiveInt
    env_steps: PositiveInt
    discovery: Annotated[dict[str, Any], DISCOVERY] = {}


class PerMethod(_Model):
    """What differs for one method."""


class PerBackend(_Model):
    """What differs for one backend; `options` go to its `make`."""

    discovery: Annotated[dict[str, Any], DISCOVERY] = {}
    options: dict[str, str | int | float | bool] = {}


class Suite(_Model):
    """A suite file. Later wins: preset, suite, `per_backend`, `per_method`, tier."""

    version: Literal[1] = Field(alias="schema")
    name: str = Field(pattern=r"^[A-Za-z0-9_-]+$")
    task: str
    backends: tuple[str, ...] = Field(min_length=1)
    methods: tuple[str, ...] = Field(min_length=1)
    tiers: dict[TierName, Tier] = Field(min_length=1)
    discovery: Annotated[dict[str, Any], DISCOVERY] = {}
    per_method: dict[str, PerMethod] = {}
    per_backend: dict[str, PerBackend] = {}


@dataclass(frozen=True)
class SuiteFile:
    """A valid suite and the file it came from."""

    suite: Suite
    source: PositionedYaml


def load_suite(path: Path) -> SuiteFile:
    """Read a suite file. Raises `SuiteError`; whether its names exist is checked when a plan is made."""
    source = PositionedYaml(path)
    if not isinstance(source.data, dict):
        raise source.mistake((), "expected `key: value` lines; see suites/pure_manip.yaml for an example")
    try:
        suite = Suite.model_validate(source.data)
    except pydantic.ValidationError as error:
        # A misspelt key also makes the right one missing: name the misspelling.
        first = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
        raise source.mistake(_without_tags(first["loc"]), _explain(first)) from None
    for key, names in (("backends", suite.backends), ("methods", suite.methods)):
        _check_names(source, key, names)
    for key, overrides, names in (
        ("per_backend", suite.per_backend, suite.backends),
        ("per_method", suite.per_method, suite.methods),
    ):
        for name in set(overrides) - set(names):
            raise source.mistake((key, name), f"not one of this suite's: {', '.join(names)}.{_guess(name, names)}")
    return SuiteFile(suite, source)


def _check_names(source: PositionedYaml, key: str, names: tuple[str, ...]) -> None:
    for index, name in enumerate(names):
        if name in names[:index]:
            raise source.mistake((key, index), f"{name!r} is listed twice")


def _without_tags(location: Location) -> Location:
    """Pydantic marks a wrong dictionary key by a last part "[key]", which stands nowhere in the file."""
    return location[:-1] if location and location[-1] == "[key]" else location


def _explain(error: ErrorDetails) -> str:
    location, given = error["loc"], error["input"]
    if error["type"] == "extra_forbidden":
        known = _known_keys(location[:-1])
        return f"unknown key.{_guess(str(location[-1]), known)} Known: {', '.join(known)}"
    if error["type"] == "missing":
        return "this key is missing"
    if error["type"] == "literal_error":
        known = _presets(location) or TIERS if location[-1] in ("preset", "[key]") else ()
        return f"{error['msg'].replace('Input should', 'should')}, got {given!r}.{_guess(str(given), known)}"
    return f"{error['msg'].replace('Input should', 'should')}, got {given!r}"


def _presets(location: Location) -> tuple[str, ...]:
    if location[-1] != "preset":
        return ()
    patch = _patch(location[:-1])
    return tuple((LEARNER.learners["SAC"] if isinstance(patch, LearnerPatch) else patch).presets) if patch else ()


def _patch(location: Location) -> Patch | LearnerPatch | DiscoveryPatch | None:
    """What the mapping at `location` is checked against, None for one of the suite's own."""
    if len(location) > 1 and location[-2] == "discovery":
        return DISCOVERY.sections[str(location[-1])]
    if len(location) > 1 and location[-2] == "learner":
        return LEARNER.learners[str(location[-1])]
    return PATCHES.get(str(location[-1])) if location else None


def _known_keys(parent: Location) -> tuple[str, ...]:
    """The keys that may stand below `parent`."""
    if patch := _patch(parent):
        return patch.keys
    below: dict[str, type[_Model]] = {"tiers": Tier, "per_method": PerMethod, "per_backend": PerBackend}
    model = below[str(parent[0])] if parent else Suite
    return tuple(field.alias or name for name, field in model.model_fields.items())


def _guess(name: str, known: Iterable[str]) -> str:
    close = difflib.get_close_matches(name, list(known), n=1)
    return f" Did you mean {close[0]!r}?" if close else ""
