"""Cells: which ones a suite asks for, and that their ids are content."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from causalbench.errors import SuiteError, UnknownNameError, UserError
from causalbench.plugins.manager import Plugins, load_plugins
from causalbench.suite.plan import DiscoveryCell, LearnerCell, Plan, content_hash, make_plan
from causalbench.suite.schema import load_suite

SUITE = """\
schema: 1
name: demo
task: pure_manipulation
backends: [kinematic]
methods: [cmSAC, cmmSAC, mSAC]
tiers:
  quick: {seeds: 2, env_steps: 1000}
  full: {seeds: 3, env_steps: 1000}
learner: {gamma: 0.9, tau: 0.01}
"""


@pytest.fixture(scope="module")
def plugins() -> Plugins:
    return load_plugins()


def plan(folder: Path, plugins: Plugins, text: str = SUITE, tier: str = "quick", **options) -> Plan:
    path = folder / "demo.yaml"
    path.write_text(text)
    return make_plan(load_suite(path), tier, plugins, **options)


def ids(plan: Plan) -> set[str]:
    return {cell.id for cell in plan.cells}


def test_quick_shares_one_discovery_and_full_gives_each_seed_its_own(tmp_path: Path, plugins: Plugins) -> None:
    quick, full = plan(tmp_path, plugins), plan(tmp_path, plugins, tier="full")
    assert [cell.seed for cell in quick.cells if isinstance(cell, DiscoveryCell)] == [0]
    assert [cell.seed for cell in full.cells if isinstance(cell, DiscoveryCell)] == [0, 1, 2]
    needing = [c for c in full.cells if isinstance(c, LearnerCell) and c.discovery]
    assert [(c.method.name, c.seed, c.discovery.seed) for c in needing] == [("cmSAC", s, s) for s in range(3)]
    assert [isinstance(cell, DiscoveryCell) for cell in full.cells] == [True] * 3 + [False] * 9


def test_an_id_is_a_slug_and_a_hash_of_what_cell_json_holds(tmp_path: Path, plugins: Plugins) -> None:
    for cell in plan(tmp_path, plugins).cells:
        reread = json.loads(json.dumps(cell.identity))
        assert reread == cell.identity
        assert cell.id.endswith(f"-s{cell.seed}-{content_hash(reread)}")


def test_the_order_of_keys_and_lists_and_other_cells_do_not_change_an_id(tmp_path: Path, plugins: Plugins) -> None:
    shuffled = SUITE.replace("gamma: 0.9, tau: 0.01", "tau: 1.0e-2, gamma: 0.9").replace(
        "cmSAC, cmmSAC, mSAC", "mSAC, cmmSAC, cmSAC"
    )
    assert ids(plan(tmp_path, plugins, shuffled)) == ids(plan(tmp_path, plugins))
    fewer = plan(tmp_path, plugins, only=["method=mSAC,seed=1"])
    assert len(ids(fewer)) == 1
    assert ids(fewer) < ids(plan(tmp_path, plugins))
    assert ids(plan(tmp_path, plugins, seeds=1)) < ids(plan(tmp_path, plugins))


def test_a_discovery_setting_changes_the_ids_of_the_learners_that_need_the_graph(
    tmp_path: Path, plugins: Plugins
) -> None:
    before, after = plan(tmp_path, plugins), plan(tmp_path, plugins, SUITE + "discovery: {kl: {patience: 4}}\n")
    changed = {cell.id.rsplit("-", 2)[0] for cell in before.cells if cell.id not in ids(after)}
    assert changed == {"pure_manipulation-kinematic", "pure_manipulation-kinematic-cmSAC"}


@pytest.mark.parametrize("field", ["code", "task", "backend", "method", "seed", "env_steps", "learner", "evaluation"])
def test_everything_that_determines_a_result_is_in_the_id(tmp_path: Path, plugins: Plugins, field: str) -> None:
    cell = plan(tmp_path, plugins).cells[-1]
    assert isinstance(cell, LearnerCell)
    other = {
        "code": "9.9",
        "task": dataclasses.replace(cell.task, version=99),
        "backend": dataclasses.replace(cell.backend, modules={"engine": "9.9"}),
        "method": dataclasses.replace(cell.method, gradient="factored"),
        "seed": 99,
        "env_steps": 99,
        "learner": dataclasses.replace(cell.learner, gamma=0.5),
        "evaluation": dataclasses.replace(cell.evaluation, every=99),
    }
    assert dataclasses.replace(cell, **{field: other[field]}).id != cell.id


def test_a_method_whose_learner_does_not_exist_is_named(tmp_path: Path, plugins: Plugins) -> None:
    strange = dataclasses.replace(plugins.method("mSAC"), name="mTD3", learner="TD3")
    with_it = dataclasses.replace(plugins, methods=plugins.methods | {"mTD3": strange})
    with pytest.raises(SuiteError, match=r"demo.yaml:5: methods.2: its learner 'TD3' is none of SAC, PPO, SB3"):
        plan(tmp_path, with_it, SUITE.replace(", mSAC]", ", mTD3]"))


def test_overrides_apply_from_suite_to_backend_to_method_to_tier(tmp_path: Path, plugins: Plugins) -> None:
    text = SUITE.replace("env_steps: 1000}\n  full", "env_steps: 1000, learner: {tau: 0.4}}\n  full") + (
        "per_backend:\n  kinematic: {learner: {gamma: 0.2, tau: 0.2, batch_size: 32}, evaluation: {every: 7}}\n"
        "per_method:\n  mSAC: {learner: {gamma: 0.3, tau: 0.3}}\n"
    )
    found = {c.method.name: c for c in plan(tmp_path, plugins, text).cells if isinstance(c, LearnerCell)}
    settings = {name: (c.learner.gamma, c.learner.tau, c.learner.batch_size) for name, c in found.items()}
    assert settings == {"cmSAC": (0.2, 0.4, 32), "cmmSAC": (0.2, 0.4, 32), "mSAC": (0.3, 0.4, 32)}
    assert found["mSAC"].evaluation.every == 7


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "[kinematic]",
            "[kinematik]",
            "demo.yaml:4: backends.0: unknown backend 'kinematik'. Did you mean 'kinematic'?",
        ),
        ("cmmSAC", "cmmSACK", "demo.yaml:5: methods.1: unknown method 'cmmSACK'. Did you mean 'cmmSAC'?"),
        (
            "learner: {gamma",
            "discovery: {discoverer: klm}\nlearner: {gamma",
            "demo.yaml:9: discovery.discoverer: unknown discoverer 'klm'. Did you mean 'kl'?",
        ),
        (
            "tau: 0.01}",
            "tau: 0.01,\n  clip_range: 0.1}",
            "demo.yaml:10: learner.clip_range: a setting of PPO and SB3-PPO methods, and cmSAC, cmmSAC, mSAC are none",
        ),
        (
            "tau: 0.01}",
            "tau: 0.01}\nper_method:\n  mSAC: {learner: {PPO: {gamma: 0.5}}}",
            "demo.yaml:11: per_method.mSAC.learner.PPO: a setting of PPO methods, and mSAC is none",
        ),
        ("task: pure_m", "task: pur_m", "demo.yaml:3: task: unknown task 'pur_manipulation'. Did you mean"),
    ],
)
def test_a_name_that_does_not_exist_is_shown_where_it_stands(
    tmp_path: Path, plugins: Plugins, old: str, new: str, message: str
) -> None:
    with pytest.raises(SuiteError) as caught:
        plan(tmp_path, plugins, SUITE.replace(old, new))
    assert str(caught.value).startswith(f"{tmp_path}/{message}")


@pytest.mark.parametrize(
    ("only", "message"),
    [
        ("method=mSACK", "unknown method in --only 'mSACK'. Did you mean 'mSAC'? Known: cmSAC, cmmSAC, mSAC."),
        ("seed=7", "unknown seed in --only '7'. Known: 0, 1."),
        ("seed=one", "--only 'seed=one': a seed is a number from 0"),
        ("robot=fetch", "--only 'robot=fetch': expected backend=NAME, method=NAME or seed=NUMBER"),
    ],
)
def test_a_wrong_selection_says_what_there_is(tmp_path: Path, plugins: Plugins, only: str, message: str) -> None:
    with pytest.raises(UserError) as caught:
        plan(tmp_path, plugins, only=[only])
    assert str(caught.value) == message


def test_a_tier_that_the_suite_lacks(tmp_path: Path, plugins: Plugins) -> None:
    with pytest.raises(UnknownNameError, match=r"unknown tier 'smoke'\. Known: full, quick\."):
        plan(tmp_path, plugins, tier="smoke")
