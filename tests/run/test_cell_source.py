"""Which packages' source code stands behind a cell."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from causalbench.digests import source_hash
from causalbench.plugins.manager import installed
from causalbench.run.cell import source_of
from causalbench.suite.plan import make_plan
from causalbench.suite.schema import load_suite

SUITE = Path(__file__).parents[2] / "suites" / "pure_manip.yaml"
KINDS = ("tasks", "backends", "methods", "learners", "discoverers")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("package", ["json", "csv"])  # a package and a module, which stand for a plugin's
def test_a_cell_names_the_plugin_of_each_part(kind: str, package: str) -> None:
    plugins = installed()
    plan = make_plan(load_suite(SUITE, plugins), "quick", plugins, 1, ["method=cmSAC"])
    moved = {key: package for key in plugins.packages if key[0] == kind}
    changed = dataclasses.replace(plugins, packages=plugins.packages | moved)
    for cell in plan.cells:
        source = dict(one.split("=") for one in source_of(cell, changed).split())
        applies = kind in ("tasks", "backends", "discoverers") or cell.identity["kind"] == "learner"
        assert source.get(package) == (source_hash(package) if applies else None)
        assert source["causalbench"] == source_hash("causalbench")
