"""Cells: which ones a suite asks for, and that their ids are content."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
from gym_tasks import CAR, CAR_THAT_FORGETS, LINE

from causalbench.core.learners.methods import Method
from causalbench.core.tasks.gym_task import GymTask
from causalbench.errors import SuiteError, UnknownNameError, UserError
from causalbench.plugins.manager import Plugins, installed, load_plugins
from causalbench.store.comparable import check_comparable
from causalbench.suite.cells import Cell, DiscoveryCell, LearnerCell, content_hash
from causalbench.suite.plan import Plan, make_plan
from causalbench.suite.schema import load_suite

SUITE = """\
schema: 1
name: demo
task: pure_manipulation
backends: [kinematic]
methods: [cmSAC, cmmSAC, mSAC]
tiers:
  quick: {seeds: 2, env_steps: 1000}
  full: {seeds: 3, env_steps: 1000, graphs: per_seed}
learner: {gamma: 0.9, tau: 0.01}
"""


@pytest.fixture(scope="module")
def plugins() -> Plugins:
    return load_plugins()


def plan(folder: Path, plugins: Plugins, text: str = SUITE, tier: str = "quick", **options) -> Plan:
    path = folder / "demo.yaml"
    path.write_text(text)
    return make_plan(load_suite(path, plugins), tier, plugins, **options)


def ids(plan: Plan) -> set[str]:
    return {cell.id for cell in plan.cells}


def test_seeds_share_one_graph_or_have_their_own(tmp_path: Path, plugins: Plugins) -> None:
    quick, full = plan(tmp_path, plugins), plan(tmp_path, plugins, tier="full")
    assert [cell.seed for cell in quick.cells if isinstance(cell, DiscoveryCell)] == [0]
    assert [cell.seed for cell in full.cells if isinstance(cell, DiscoveryCell)] == [0, 1, 2]
    needing = [c for c in full.cells if isinstance(c, LearnerCell) and c.discovery]
    assert [(c.method.name, c.seed, c.discovery.seed) for c in needing] == [("cmSAC", s, s) for s in range(3)]
    assert [isinstance(cell, DiscoveryCell) for cell in full.cells] == [True] * 3 + [False] * 9


def test_a_method_that_names_a_discoverer_has_it_whichever_the_suite_chooses(tmp_path: Path, plugins: Plugins) -> None:
    methods = SUITE.replace("[cmSAC, cmmSAC, mSAC]", "[cmSAC, cmSAC-kl, mSAC]")
    ours = plan(tmp_path, plugins, methods + "discovery: {discoverer: paired, kl: {max_epochs: 7}}\n", seeds=1)
    by_kl = plan(tmp_path, plugins, SUITE + "discovery: {kl: {max_epochs: 7}}\n", seeds=1)
    found = {cell.method.name: cell for cell in ours.cells if isinstance(cell, LearnerCell)}
    asked = {name: cell.discovery.settings.discoverer for name, cell in found.items() if cell.discovery}
    assert asked == {"cmSAC": "paired", "cmSAC-kl": "kl"}
    assert found["cmSAC-kl"].discovery.id in ids(by_kl)
    assert found["mSAC"].id in ids(by_kl)
    check_comparable((cell.id, cell.identity) for cell in ours.cells)


def test_a_method_that_names_a_discoverer_is_one_row_of_a_grid_of_them(tmp_path: Path, plugins: Plugins) -> None:
    methods = SUITE.replace("[cmSAC, cmmSAC, mSAC]", "[cmSAC, cmSAC-kl]")
    text = methods + "grid: {discovery.discoverer: [kl, paired], discovery.kl.max_epochs: [7, 9]}\n"
    cells = [cell for cell in plan(tmp_path, plugins, text, seeds=1).cells if isinstance(cell, LearnerCell)]
    points = {(cell.method.name, *cell.grid_point.values()) for cell in cells}
    assert points == {
        ("cmSAC", "kl", 7), ("cmSAC", "kl", 9), ("cmSAC", "paired"), ("cmSAC-kl", 7), ("cmSAC-kl", 9),
    }  # fmt: skip


def test_a_method_of_a_plugin_may_name_a_discoverer_that_is_not_there(tmp_path: Path, plugins: Plugins) -> None:
    mine = Method("cmMine", "SAC", "causal", "factored", "discovered", discoverer="klm")
    having = dataclasses.replace(plugins, methods=plugins.methods | {"cmMine": mine})
    with pytest.raises(SuiteError, match=r"demo.yaml:5: methods\.1: unknown discoverer 'klm'. Did you mean 'kl'"):
        plan(tmp_path, having, SUITE.replace("[cmSAC, cmmSAC, mSAC]", "[cmSAC, cmMine]"))


def test_a_discoverer_of_a_method_that_discovers_nothing_is_refused() -> None:
    with pytest.raises(
        ValueError, match="method 'mMine': discoverer 'kl' would be ignored, since its matrix is 'none'"
    ):
        Method("mMine", "SAC", "full", "scalar", "none", discoverer="kl")


def test_seeds_begin_with_the_suites_first_one(tmp_path: Path, plugins: Plugins) -> None:
    later = SUITE.replace("task:", "first_seed: 100\ntask:")
    quick = plan(tmp_path, plugins, later)
    assert {cell.seed for cell in quick.cells} == {100, 101}
    assert [cell.seed for cell in quick.cells if isinstance(cell, DiscoveryCell)] == [100]
    assert {cell.seed for cell in plan(tmp_path, plugins, later, seeds=1).cells} == {100}
    assert {cell.seed for cell in plan(tmp_path, plugins, later, only=["seed=101"]).cells} == {100, 101}  # the graph's
    with pytest.raises(UnknownNameError, match="seed"):
        plan(tmp_path, plugins, later, only=["seed=0"])


def test_a_tier_may_have_backends_of_its_own_and_say_what_differs_there(tmp_path: Path, plugins: Plugins) -> None:
    tiers = (
        "  look: {seeds: 1, env_steps: 100, backends: {kinematic: {env_steps: 900, learner: {gamma: 0.5}}, gymrob: {}}}"
    )
    text = SUITE.replace("tiers:", f"tiers:\n{tiers}\n").replace("kinematic]", "pybullet]")
    found = [cell for cell in plan(tmp_path, plugins, text, "look").cells if isinstance(cell, LearnerCell)]
    assert {(c.backend.name, c.env_steps, c.learner.gamma) for c in found} == {
        ("kinematic", 900, 0.5),
        ("gymrob", 100, 0.9),
    }
    assert {cell.backend.name for cell in plan(tmp_path, plugins, text).cells} == {"pybullet"}
    for wrong, message in (
        ("gymrob: {envsteps: 5}", "tiers.look.backends.gymrob.envsteps: unknown key. Did you mean 'env_steps'?"),
        ("gymrob: {learner: {gama: 1}}", "tiers.look.backends.gymrob.learner.gama: unknown key"),
        ("gymrub: {}", "tiers.look.backends.gymrub: unknown backend 'gymrub'"),
    ):
        with pytest.raises(SuiteError) as caught:
            plan(tmp_path, plugins, text.replace("gymrob: {}", wrong), "look")
        assert message in str(caught.value)


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


def test_a_tier_may_have_any_name_and_say_itself_whether_seeds_share_a_graph(tmp_path: Path, plugins: Plugins) -> None:
    text = SUITE.replace("  full:", "  medium:").replace("name: demo", "name: demo\ngraphs: per_seed")
    text = text.replace("quick: {", "quick: {graphs: shared, ")
    seeds = {
        tier: [c.seed for c in plan(tmp_path, plugins, text, tier).cells if isinstance(c, DiscoveryCell)]
        for tier in ("quick", "medium")
    }
    assert seeds == {"quick": [0], "medium": [0, 1, 2]}


GRID = """\
grid:
  learner.learning_rate: [1e-3, 3e-4]
  learner.PPO.n_epochs: [2, 4]
  discovery.training_count: [100, 200]
"""


def points(cells: list[Cell]) -> list[tuple[Any, ...]]:
    return [tuple(cell.grid_point.values()) for cell in cells]


def test_a_grid_runs_every_combination_of_what_reaches_a_cell(tmp_path: Path, plugins: Plugins) -> None:
    whole = plan(tmp_path, plugins, SUITE.replace("mSAC]", "mSAC, mPPO]") + GRID, seeds=1)
    found = whole.cells
    assert len(ids(whole)) == len(found)
    by_method = {name: [c for c in found if isinstance(c, LearnerCell) and c.method.name == name] for name in (
        "cmSAC", "cmmSAC", "mSAC", "mPPO",
    )}  # fmt: skip
    rates = [(0.001,), (0.0003,)]
    assert points(by_method["mSAC"]) == points(by_method["cmmSAC"]) == rates
    assert points(by_method["mPPO"]) == [(r, n) for (r,) in rates for n in (2, 4)]
    assert points(by_method["cmSAC"]) == [(r, n) for (r,) in rates for n in (100, 200)]
    assert points([c for c in found if isinstance(c, DiscoveryCell)]) == [(100,), (200,)]
    for cell in by_method["cmSAC"]:
        rate, count = cell.grid_point.values()
        assert (cell.learner.learning_rate, cell.discovery.settings.training_count) == (rate, count)
        assert cell.identity["grid_point"] == {"learner.learning_rate": rate, "discovery.training_count": count}
    assert [c.learner.n_epochs for c in by_method["mPPO"]] == [2, 4, 2, 4]


def test_an_oracle_is_asked_about_actions_held_as_long_as_the_discoverys(tmp_path: Path, plugins: Plugins) -> None:
    text = SUITE.replace("cmSAC, cmmSAC, mSAC", "cmSAC, cmSAC-oracle, mSAC") + "discovery: {action_repeat: 3}\n"
    cells = [cell for cell in plan(tmp_path, plugins, text).cells if isinstance(cell, LearnerCell)]
    held = {cell.method.name: (cell.action_repeat, cell.discovery is None) for cell in cells}
    assert held == {"cmSAC": (1, False), "cmSAC-oracle": (3, True), "mSAC": (1, True)}
    other = plan(tmp_path, plugins, text.replace("repeat: 3", "repeat: 2"))
    kept = {cell.method.name for cell in other.cells if isinstance(cell, LearnerCell) and cell in cells}
    assert kept == {"mSAC"}


def test_a_tier_may_have_a_grid_of_its_own(tmp_path: Path, plugins: Plugins) -> None:
    text = SUITE.replace("quick: {", "quick: {grid: {}, ").replace("cmmSAC", "mPPO") + GRID
    assert len(plan(tmp_path, plugins, text, seeds=1).cells) == 1 + 3
    assert len(plan(tmp_path, plugins, text, "full", seeds=1).cells) == 2 + 4 + 2 + 4


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("learner.gama: [0.5]", "11: grid.learner.gama.0: unknown key. Did you mean 'gamma'?"),
        ("learner.gamma: [0.5, 2]", "11: grid.learner.gamma.1: should be less than or equal to 1, got 2"),
        ("learner.gamma: [0.5, 0.5]", "11: grid.learner.gamma.1: 0.5 is listed twice"),
        ("learner.gamma: []", "11: grid.learner.gamma: Tuple should have at least 1 item"),
        ("learner.gamma: 0.5", "11: grid.learner.gamma: should be a valid array"),
        ("seeds: [1, 2]", "11: grid.seeds: expected learner.KEY, discovery.KEY, evaluation.KEY"),
        ("learner.n_epochs: [1]", "11: grid.learner.n_epochs.0: a setting of PPO and SB3-PPO methods, and cmSAC"),
        ("discovery.discoverer: [kl, pared]", "11: grid.discovery.discoverer.1: unknown discoverer 'pared'. Did you"),
    ],
)
def test_a_mistake_in_the_grid_is_shown_where_it_stands(
    tmp_path: Path, plugins: Plugins, line: str, message: str
) -> None:
    with pytest.raises(SuiteError) as caught:
        plan(tmp_path, plugins, f"{SUITE}grid:\n  {line}\n")
    assert str(caught.value).startswith(f"{tmp_path}/demo.yaml:{message}")


def test_a_grid_of_too_many_cells_is_refused(tmp_path: Path, plugins: Plugins) -> None:
    many = "\n".join(f"  learner.{key}: {[n + 1 for n in range(50)]}" for key in ("batch_size", "train_every"))
    with pytest.raises(SuiteError, match=r"demo.yaml:10: grid: 150000 cells; the most is 10000$"):
        plan(tmp_path, plugins, f"{SUITE}grid:\n{many}\n", seeds=20)


def test_a_suite_without_methods_asks_for_graphs(tmp_path: Path, plugins: Plugins) -> None:
    text = SUITE.partition("learner:")[0].replace("[cmSAC, cmmSAC, mSAC]", "[]").replace(", env_steps: 1000", "")
    text += "grid:\n  discovery.discoverer: [kl, paired]\n  discovery.kl.epsilon_cv: [1.0, 2.0]\n"
    found = plan(tmp_path, plugins, text).cells
    assert all(isinstance(cell, DiscoveryCell) for cell in found)
    # `paired` has no epsilon_cv, so that its combinations are the same cells.
    assert [(c.settings.discoverer, *list(c.grid_point.values())[1:], c.seed) for c in found] == [
        ("kl", 1.0, 0), ("kl", 1.0, 1), ("kl", 2.0, 0), ("kl", 2.0, 1), ("paired", 0), ("paired", 1)
    ]  # fmt: skip
    shared = text.replace("name: demo", "name: demo\ngraphs: shared")
    assert [cell.seed for cell in plan(tmp_path, plugins, shared).cells] == [0, 0, 0]
    with pytest.raises(SuiteError, match=r"demo.yaml:9: learner.gamma: .* and this suite has none"):
        plan(tmp_path, plugins, text.replace("grid:", "learner: {gamma: 0.5}\ngrid:"))


def test_a_backend_that_cannot_run_the_task_is_skipped_with_its_reason(tmp_path: Path, plugins: Plugins) -> None:
    standing = dataclasses.replace(
        plugins.backends["kinematic"], name="standing", variants=plugins.backends["kinematic"].variants[:1]
    )
    with_it = dataclasses.replace(
        plugins,
        backends=plugins.backends | {"standing": standing},
        owners=plugins.owners | {"standing": plugins.owners["kinematic"]},
    )
    text = SUITE.replace("task: pure_manipulation", "task: mobile_manipulation")
    found = plan(tmp_path, with_it, text.replace("[kinematic]", "[kinematic, standing]"))
    reasons = {cell.backend.name: found.impossible.get(cell.id, "") for cell in found.cells}
    assert reasons["kinematic"] == ""
    assert reasons["standing"].startswith("backend 'standing' cannot run task 'mobile_manipulation'")
    assert len(found.impossible) == len(found.cells) / 2


def test_a_task_whose_code_raises_is_a_mistake_of_the_suite_that_names_it(tmp_path: Path, plugins: Plugins) -> None:
    def rewards(*seen: Any) -> Any:
        return 1 / 0

    broken = dataclasses.replace(plugins.tasks["pure_manipulation"], rewards=rewards)
    with_it = dataclasses.replace(plugins, tasks={"pure_manipulation": broken})
    with pytest.raises(SuiteError, match=r"demo.yaml:3: task: task 'pure_manipulation': .* raises ZeroDivisionError"):
        plan(tmp_path, with_it)


def test_a_learner_that_lacks_a_library_says_how_to_install_it(tmp_path: Path, plugins: Plugins) -> None:
    lacking = dataclasses.replace(plugins.learners["SAC"], modules=("a_library_that_is_not_here",), extra="mine[x]")
    without = dataclasses.replace(plugins, learners=plugins.learners | {"SAC": lacking})
    with pytest.raises(SuiteError) as caught:
        plan(tmp_path, without)
    assert str(caught.value).endswith(
        "demo.yaml:5: methods.0: learner 'SAC' needs a_library_that_is_not_here, not installed here; "
        "run: pip install 'mine[x]'"
    )


GYM_SUITE = """\
schema: 1
name: demo
task: mountain_car
backends: [gymnasium, kinematic]
methods: [METHODS]
tiers:
  quick: {seeds: 1, env_steps: 1000}
discovery: {discoverer: DISCOVERER, oracle_states: STATES}
"""


def gym_plan(folder: Path, plugins: Plugins, task: GymTask, methods: str, discoverer: str, states: int = 0) -> Plan:
    text = GYM_SUITE.replace("METHODS", methods).replace("DISCOVERER", discoverer).replace("STATES", str(states))
    return plan(folder, dataclasses.replace(plugins, tasks=plugins.tasks | {task.name: task}), text)


@pytest.mark.parametrize(("methods", "discoverer", "states", "refused"), [
    ("cmSAC, mSAC", "kl", 0, {}),
    ("cmSAC, mSAC", "paired", 0, dict.fromkeys(["", "cmSAC"], "discoverer 'paired' needs the capability 'restore'")),
    ("cmSAC, mSAC", "kl", 50,
     dict.fromkeys(["", "cmSAC"], "the oracle (`oracle_states`) needs the capability 'restore'")),
    ("cmSAC-oracle, mSAC", "kl", 0,
     {"cmSAC-oracle": "method 'cmSAC-oracle', which asks the oracle, needs the capability 'restore'"}),
    ("cmSAC-plus1, mSAC", "kl", 0,
     {"cmSAC-plus1": "method 'cmSAC-plus1', whose control an expert must solve, needs the capability 'expert'"}),
])  # fmt: skip
def test_what_an_environment_cannot_do_is_skipped_before_anything_runs(
    tmp_path: Path, plugins: Plugins, methods: str, discoverer: str, states: int, refused: dict[str, str]
) -> None:
    bare = dataclasses.replace(CAR_THAT_FORGETS, expert=None)
    found = gym_plan(tmp_path, plugins, bare, methods, discoverer, states)
    asked = [cell for cell in found.cells if cell.backend.name == "gymnasium"]
    reasons = {getattr(cell, "method", NONE).name: found.impossible.get(cell.id) for cell in asked}
    end = ", and gymnasium does not have it in task 'mountain_car'"
    assert {name: reason for name, reason in reasons.items() if reason} == {n: r + end for n, r in refused.items()}
    whole = gym_plan(tmp_path, plugins, CAR, methods, discoverer, states)
    other = "backend 'kinematic' cannot run task 'mountain_car', which has environments for gymnasium alone"
    skipped = {cell.id for cell in whole.cells if cell.backend.name == "kinematic"}
    assert whole.impossible == dict.fromkeys(skipped, other)


NONE = Method("", learner="SAC", action_space="full", gradient="scalar", matrix="none")


def test_a_task_over_scenes_is_skipped_where_there_are_none(tmp_path: Path, plugins: Plugins) -> None:
    found = plan(tmp_path, plugins, SUITE.replace("[kinematic]", "[kinematic, gymnasium]"))
    reasons = {cell.backend.name: found.impossible.get(cell.id, "") for cell in found.cells}
    assert reasons["kinematic"] == ""
    assert "backend 'gymnasium' makes no scenes" in reasons["gymnasium"]


def test_what_the_environments_need_is_named_and_its_version_recorded(tmp_path: Path, plugins: Plugins) -> None:
    lacking = dataclasses.replace(CAR, modules=("a_simulator_that_is_not_here",))
    found = gym_plan(tmp_path, plugins, lacking, "mSAC", "kl")
    assert (
        "backend 'gymnasium' cannot run task 'mountain_car': its environments need a_simulator_that_is_not_here, "
        "not installed here"
    ) in found.impossible.values()
    (cell,) = (
        cell
        for cell in gym_plan(tmp_path, plugins, dataclasses.replace(CAR, modules=("yaml",)), "mSAC", "kl").cells
        if cell.backend.name == "gymnasium"
    )
    assert set(cell.backend.modules) == {"gymnasium", "PyYAML"}


def test_options_that_the_maker_of_an_environment_does_not_take_are_a_mistake(tmp_path: Path, plugins: Plugins) -> None:
    with pytest.raises(SuiteError, match=r"per_backend.gymnasium.options: options of task 'line' .* it takes start"):
        plan(
            tmp_path,
            dataclasses.replace(plugins, tasks=plugins.tasks | {"line": LINE}),
            GYM_SUITE.replace("mountain_car", "line").replace("METHODS", "mSAC").replace("DISCOVERER", "kl")
            .replace("STATES", "0") + "per_backend: {gymnasium: {options: {speed: 3}}}\n",
        )  # fmt: skip


@pytest.mark.parametrize("path", sorted((Path(__file__).parents[2] / "suites").glob("*.yaml")), ids=lambda p: p.stem)
def test_the_cells_of_every_tier_of_a_shipped_suite_may_stand_in_one_folder(path: Path) -> None:
    file = load_suite(path, installed())
    for tier in file.suite.tiers:
        check_comparable((cell.id, cell.identity) for cell in make_plan(file, tier, installed()).cells)


def test_a_plan_states_the_whole_tier_whatever_is_picked_of_it(tmp_path: Path, plugins: Plugins) -> None:
    text = SUITE + "hypotheses: [cmSAC > mSAC, cmSAC == cmmSAC within 0.10]\nfirst_seed: 5\n"
    whole = plan(tmp_path, plugins, text).statement
    assert whole.hypotheses == ("cmSAC > mSAC", "cmSAC == cmmSAC within 0.1")
    assert (whole.suite, whole.tier, whole.backends, whole.seeds) == ("demo", "quick", ("kinematic",), (5, 6))
    assert plan(tmp_path, plugins, text, only=["method=mSAC,seed=6"]).statement == whole
    assert plan(tmp_path, plugins, text, seeds=4).statement.seeds == (5, 6, 7, 8)


def test_a_hypothesis_needs_methods_of_one_point_of_the_grid(tmp_path: Path, plugins: Plugins) -> None:
    with pytest.raises(SuiteError, match=r"hypotheses\.0: the grid has 'cmSAC' at several points; a hypothesis needs"):
        plan(tmp_path, plugins, SUITE.replace("mSAC]", "mSAC, mPPO]") + "hypotheses: [cmSAC > mSAC]\n" + GRID)


DONORS = SUITE.replace("[kinematic]", "[kinematic, pybullet]") + "grid:\n  discovery.backend: [kinematic, pybullet]\n"


def test_a_graph_may_come_from_another_backend(tmp_path: Path, plugins: Plugins) -> None:
    found = plan(tmp_path, plugins, DONORS, seeds=1).cells
    learners = [cell for cell in found if isinstance(cell, LearnerCell)]
    donors = {(c.backend.name, c.discovery.backend.name) for c in learners if c.discovery}
    assert donors == {(a, b) for a in ("kinematic", "pybullet") for b in ("kinematic", "pybullet")}
    for cell in learners:
        assert dict(cell.grid_point) == ({"discovery.backend": cell.discovery.backend.name} if cell.discovery else {})
    # Each discovery once, and the same as without a grid.
    alone = plan(tmp_path, plugins, DONORS.partition("grid:")[0], seeds=1).cells
    assert {c.id for c in found if isinstance(c, DiscoveryCell)} == {
        c.id for c in alone if isinstance(c, DiscoveryCell)
    }


def test_a_backend_that_gives_graphs_alone_is_planned_and_checked_too(tmp_path: Path, plugins: Plugins) -> None:
    text = DONORS.replace("[kinematic, pybullet]\nmethods", "[kinematic]\nmethods")
    found = plan(tmp_path, plugins, text, seeds=1)
    assert {cell.backend.name for cell in found.cells if isinstance(cell, DiscoveryCell)} == {"kinematic", "pybullet"}
    assert {cell.backend.name for cell in found.cells if isinstance(cell, LearnerCell)} == {"kinematic"}
    with pytest.raises(SuiteError, match=r"grid\.discovery\.backend: unknown backend 'bullet'"):
        plan(tmp_path, plugins, text.replace("[kinematic, pybullet]", "[kinematic, bullet]"))
    with pytest.raises(SuiteError, match=r"grid\.discovery\.backend\.1: expected the name of a backend, got 3"):
        plan(tmp_path, plugins, text.replace("[kinematic, pybullet]", "[kinematic, 3]"))


TASKS = SUITE.replace("[kinematic, pybullet]", "[kinematic]") + (
    "grid:\n  task: [pure_manipulation, pure_manipulation+halved, pure_manipulation+merged]\n"
    "  discovery.task: [pure_manipulation]\n"
)


def test_a_grid_of_tasks_has_cells_of_each_and_graphs_of_another(tmp_path: Path, plugins: Plugins) -> None:
    found = plan(tmp_path, plugins, TASKS, seeds=1)
    learners = [cell for cell in found.cells if isinstance(cell, LearnerCell)]
    names = [f"pure_manipulation{change}" for change in ("", "+halved", "+merged")]
    assert list(dict.fromkeys(cell.task.name for cell in learners)) == names
    assert {cell.grid_point["task"] for cell in learners} == {*names}
    assert {cell.discovery.task.name for cell in learners if cell.discovery} == {"pure_manipulation"}
    assert {c.task.name for c in found.cells if isinstance(c, DiscoveryCell)} == {"pure_manipulation"}
    assert all("discovery.task" not in cell.grid_point for cell in learners if cell.discovery is None)


def test_a_graph_that_does_not_fit_the_task_is_said_to(tmp_path: Path, plugins: Plugins) -> None:
    found = plan(tmp_path, plugins, TASKS, seeds=1)
    learners = [cell for cell in found.cells if isinstance(cell, LearnerCell) and cell.discovery]
    refused = {cell.task.name: found.impossible.get(cell.id, "") for cell in learners}
    assert refused["pure_manipulation"] == refused["pure_manipulation+halved"] == ""
    assert "their n_stages differ" in refused["pure_manipulation+merged"]


@pytest.mark.parametrize(
    ("values", "message"),
    [("[pure_manipulation+mergd]", "Did you mean 'merged'"), ("[3]", "expected the name of a task")],
)
def test_a_wrong_task_in_a_grid_is_refused(tmp_path: Path, plugins: Plugins, values: str, message: str) -> None:
    text = TASKS.partition("grid:")[0] + f"grid:\n  task: {values}\n"
    with pytest.raises(UserError, match=message):
        plan(tmp_path, plugins, text, seeds=1)
