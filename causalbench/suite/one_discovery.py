"""The suite of a single causal discovery, from what a command line says of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import yaml

from causalbench.core.discovery.settings import SHARED
from causalbench.errors import SuiteError, UnknownNameError
from causalbench.plugins.manager import Plugins
from causalbench.suite.plan import Plan, make_plan
from causalbench.suite.positions import Location
from causalbench.suite.schema import SuiteFile, check_suite

TIER = "discover"


@dataclass(frozen=True)
class CommandLine:
    """The data of a suite whose values were given as options of `causalbench discover`."""

    data: Any

    @cached_property
    def text(self) -> str:
        """The suite file that asks for the same."""
        text: str = yaml.safe_dump(self.data, sort_keys=False)
        return text

    def mistake(self, location: Location, message: str) -> SuiteError:
        """The error "option: message" for the value at `location`."""
        return SuiteError(f"{self._option(location)}: {message}")

    def _option(self, location: Location) -> str:
        """The option that says what stands at `location`."""
        match location:
            case ("discovery", "preset" | "discoverer" as name):
                return f"--{name}"
            case ("discovery", first, *rest):
                own = rest and first == self.data["discovery"]["discoverer"]
                return f"--set {'.'.join(map(str, rest if own else (first, *rest)))}"
            case ("first_seed",):
                return "--seed"
            case ("per_backend", _, "options", *key):
                return f"--option {'.'.join(map(str, key))}"
        return f"--{str(location[0] if location else 'task').removesuffix('s')}"


def plan_discovery(
    task: str,
    backend: str,
    seed: int,
    discovery: Mapping[str, Any],
    options: Mapping[str, Any],
    plugins: Plugins,
) -> tuple[Plan, SuiteFile]:
    """The plan of one discovery cell, and the suite that asks for it; `options` are the backend's.

    `discovery` is the suite's section of that name. Raises `SuiteError` or another `UserError`.
    """
    data: dict[str, Any] = {
        "schema": 1,
        "name": "discover",
        "task": task,
        "backends": [backend],
        "methods": [],
        "first_seed": seed,
        "tiers": {TIER: {"seeds": 1}},
        "discovery": dict(discovery),
    }
    if options:
        data["per_backend"] = {backend: {"options": dict(options)}}
    file = check_suite(CommandLine(data), plugins)
    return make_plan(file, TIER, plugins), file


def discovery_section(discoverer: str, preset: str, given: Mapping[str, Any], plugins: Plugins) -> dict[str, Any]:
    """The section `discovery` for a discoverer and settings by name, shared ones or its own.

    Raises `UnknownNameError` for a discoverer or a setting that does not exist.
    """
    row = plugins.discoverer(discoverer)
    for name in given:
        if name not in SHARED and name not in row.option_names:
            raise UnknownNameError(f"setting of discoverer {discoverer!r}", name, (*SHARED, *row.option_names))
    shared = {name: value for name, value in given.items() if name in SHARED}
    own = {name: value for name, value in given.items() if name not in SHARED}
    return {"discoverer": discoverer, "preset": preset, **shared} | ({discoverer: own} if own else {})
