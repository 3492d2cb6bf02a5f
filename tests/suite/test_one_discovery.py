"""The suite of one discovery, as a command line asks for it."""

from __future__ import annotations

from pathlib import Path

import pytest

from causalbench.errors import UserError
from causalbench.plugins.manager import Plugins, load_plugins
from causalbench.suite.one_discovery import discovery_section, plan_discovery
from causalbench.suite.plan import make_plan
from causalbench.suite.schema import load_suite


@pytest.fixture(scope="module")
def plugins() -> Plugins:
    return load_plugins()


def test_it_is_the_cell_that_the_written_suite_asks_for(plugins: Plugins, tmp_path: Path) -> None:
    section = discovery_section("kl", "paper", {"training_count": 50, "epsilon_cv": 2.0}, plugins)
    plan, file = plan_discovery("pure_manipulation", "kinematic", 3, section, {"mobile": False}, plugins)
    (cell,) = plan.cells
    assert (cell.seed, cell.backend.options, cell.settings.training_count) == (3, {"mobile": False}, 50)
    assert (cell.settings.options.epsilon_cv, cell.settings.options.patience) == (2.0, 0)  # patience: the preset's
    path = tmp_path / "suite.yaml"
    path.write_text(file.source.text)
    again = make_plan(load_suite(path, plugins), "discover", plugins)
    assert [again_cell.id for again_cell in again.cells] == [cell.id]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"preset": "papr"},
            "--preset: should be 'quick', 'paper' or 'paper_large', got 'papr'. Did you",
        ),
        ({"discoverer": "kll"}, "unknown discoverer 'kll'. Did you mean 'kl'?"),
        ({"given": {"epsilon_c": 1}}, "unknown setting of discoverer 'kl' 'epsilon_c'. Did you mean 'epsilon_cv'?"),
        ({"given": {"epsilon_cv": -1}}, "--set epsilon_cv: should be greater than or equal to 0, got -1"),
        ({"given": {"training_count": 0.5}}, "--set training_count: should be a valid integer"),
        ({"backend": "kinematik"}, "--backend: unknown backend 'kinematik'. Did you mean 'kinematic'?"),
        ({"task": "pure"}, "--task: unknown task 'pure'"),
        ({"seed": 10**9 + 1}, "--seed: should be less than or equal to 1000000000"),
        ({"options": {"control_hz": [1]}}, "--option control_hz"),
    ],
)
def test_a_mistake_names_the_option(plugins: Plugins, changed: dict, message: str) -> None:
    asked = {"task": "pure_manipulation", "backend": "kinematic", "seed": 0, "options": {}} | changed
    discoverer, preset, given = (asked.pop(k, v) for k, v in (("discoverer", "kl"), ("preset", "quick"), ("given", {})))

    def ask() -> None:
        section = discovery_section(discoverer, preset, given, plugins)
        plan_discovery(**asked, discovery=section, plugins=plugins)

    with pytest.raises(UserError) as caught:
        ask()
    assert str(caught.value).startswith(message)
