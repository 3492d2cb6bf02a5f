"""What every discoverer owes: settings that are checked, evidence that is described, no heavy import to be listed."""

import ast
import dataclasses
import functools
import subprocess
import sys
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pydantic
import pytest
from scenes import discover
from toy import make_toy, toy_task

import causalbench
from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.edges import EDGE, RESERVED, edge_rows
from causalbench.core.discovery.graph import CausalGraph, EvidenceColumn, StageGraph
from causalbench.core.discovery.methods.paired import PairedSettings
from causalbench.core.discovery.registry import Discoverer
from causalbench.core.discovery.settings import PRESETS, DiscoverySettings
from causalbench.errors import DiscovererError, UnknownNameError, UserError

QUICK = {
    "anytime": {"max_actions": 200},
    "hrt": {"redraws": 2},
    "kl": {"max_epochs": 2},
    "cmi": {"max_epochs": 2},
    "cai": {"max_epochs": 2, "redraws": 2},
    "kci": {"samples": 60},
    "permutation": {"states": 20},
}


def _quiet(share, doing):
    pass


def _planted(previous, action, now):
    """The first term is caused by armx, the second never varies."""
    return np.stack([action[..., 0], np.full(action.shape[:-1], -0.5)], axis=-1)


@functools.cache
def graph_of(name):
    """A small graph of one discoverer."""
    settings = DISCOVERERS[name].configure("quick", {"training_count": 160}, QUICK.get(name))
    return discover(toy_task(_planted, 2), make_toy, settings, 0, _quiet)


@pytest.mark.parametrize("name", DISCOVERERS)
def test_every_setting_has_a_default_within_its_bounds(name):
    record = DISCOVERERS[name].settings
    adapter = pydantic.TypeAdapter(record)
    for settings in (record(), *DISCOVERERS[name].presets.values()):
        assert adapter.validate_python(dataclasses.asdict(settings)) == settings
    numbers = [k for k, hint in get_type_hints(record, include_extras=True).items() if hint in (int, float)]
    assert not numbers, "a number without bounds"


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("kl", {"epsilon_cv": -1}),
        ("kl", {"fdr": 1.5}),
        ("kl", {"select": "all"}),
        ("cmi", {"batch_size": 0}),
        ("paired", {"max_actions": 0}),
        ("permutation", {"level": 0}),
        ("kci", {"samples": 1.5}),
    ],
)
def test_settings_out_of_bounds_are_refused_by_their_own_metadata(name, wrong):
    with pytest.raises(pydantic.ValidationError):
        pydantic.TypeAdapter(DISCOVERERS[name].settings).validate_python(wrong)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("name", DISCOVERERS)
def test_a_preset_is_the_shared_one_and_the_discoverers_of_that_name(name, preset):
    row = DISCOVERERS[name]
    settings = row.configure(preset, {"action_repeat": 2})
    options = row.presets.get(preset, row.settings())
    expected = dataclasses.replace(PRESETS[preset], discoverer=name, action_repeat=2, options=options)
    assert settings == expected


@pytest.mark.parametrize("name", DISCOVERERS)
def test_settings_and_presets_that_do_not_exist_are_refused_with_the_nearest(name):
    with pytest.raises(UnknownNameError, match=f"unknown setting of discoverer {name!r} 'trainin_count'. Did you mean"):
        DISCOVERERS[name].configure(own={"trainin_count": 1})
    with pytest.raises(UnknownNameError, match=r"unknown preset 'papr'\. Did you mean 'paper'"):
        DISCOVERERS[name].configure("papr")


def test_the_record_of_another_discoverer_is_refused():
    settings = DiscoverySettings(discoverer="kl", options=PairedSettings())
    with pytest.raises(UserError, match="discoverer 'kl' takes KLSettings as options, got PairedSettings"):
        discover(toy_task(_planted, 2), make_toy, settings, 0, _quiet)


@pytest.mark.parametrize("name", DISCOVERERS)
def test_evidence_is_described_and_there(name):
    graph, row = graph_of(name), DISCOVERERS[name]
    (stage,) = graph.stages
    assert graph.columns == row.evidence
    assert {column.name for column in row.evidence} == set(stage.evidence)
    assert all(column.sentence and column.name not in RESERVED for column in row.evidence)
    assert graph.main_column in row.evidence
    for column in row.evidence:
        values = stage.evidence[column.name]
        assert values.shape == {"edge": (3, 2), "term": (2,)}.get(column.per, values.shape)
        assert np.isfinite(values).all()


@pytest.mark.parametrize("name", DISCOVERERS)
def test_a_graph_comes_back_from_its_file_and_names_its_settings(name, tmp_path):
    graph = graph_of(name)
    (tmp_path / "graph.json").write_text(graph.to_json())
    again = CausalGraph.load(tmp_path / "graph.json")
    assert again.hash == graph.hash
    assert again.columns == graph.columns
    assert again.provenance["settings"]["options"] == dataclasses.asdict(
        DISCOVERERS[name].configure(own=QUICK.get(name)).options
    )
    assert again.provenance["versions"]["causalbench"]


@pytest.mark.parametrize("name", DISCOVERERS)
def test_rows_of_edges_have_the_same_columns_for_all_and_then_the_evidence(name):
    graph = graph_of(name)
    table = list(edge_rows(graph))
    shown = [column.name for column in graph.columns if column.per != "stage"]
    assert list(table[0]) == [*EDGE, *shown]
    assert [(row["term"], row["action"]) for row in table] == [
        (reward, action) for reward in ("r_0", "r_1") for action in ("armx", "army", "armz")
    ]
    for row, selected in zip(table, graph.stages[0].matrix.T.ravel(), strict=True):
        assert row["selected"] == selected


def test_a_graph_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(UserError, match=r"none\.json: cannot be read"):
        CausalGraph.load(tmp_path / "none.json")


# A stranger's discoverer, right and wrong.


def _found(evidence, matrix=None):
    def discover_stage(problem):
        terms = problem.task.stage_terms(problem.stage, discoverable_only=True)
        chosen = np.ones((3, 2), dtype=bool) if matrix is None else matrix
        return StageGraph(problem.stage, problem.task.actions, terms, chosen, evidence=evidence)

    return discover_stage


def _run(row):
    return discover(
        toy_task(_planted, 2), make_toy, DiscoverySettings(row.name), 0, _quiet, discoverers={row.name: row}
    )


COLUMNS = (EvidenceColumn("size", "m", "how large it is", main=True), EvidenceColumn("spread", "m", "of it", "term"))


@pytest.mark.parametrize(
    ("evidence", "matrix", "message"),
    [
        ({"seize": np.ones((3, 2))}, None, "evidence 'seize' is not described"),
        ({"size": np.ones((2, 3))}, None, r"evidence 'size': expected \(3, 2\), got float64 \(2, 3\)"),
        ({"spread": np.ones((3, 2))}, None, r"evidence 'spread': expected \(2,\), got"),
        ({"size": np.full((3, 2), np.nan)}, None, "evidence 'size' is not finite"),
        ({}, np.ones((3, 2)), r"matrix: expected bool \(3, 2\), got float64"),
    ],
)
def test_what_was_not_described_is_refused_by_name(evidence, matrix, message):
    with pytest.raises(DiscovererError, match=message):
        _run(Discoverer("mine", _found(evidence, matrix), "", evidence=COLUMNS))


def test_a_discoverer_that_returns_nothing_is_named():
    with pytest.raises(DiscovererError, match="discoverer 'mine': expected a StageGraph, got None"):
        _run(Discoverer("mine", lambda problem: None, ""))


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ([EvidenceColumn("selected", "", "")], "evidence 'selected': tables have such a column"),
        ([EvidenceColumn("oracle_effect", "", "")], "evidence 'oracle_effect': tables"),
        ([EvidenceColumn("a", "", ""), EvidenceColumn("a", "", "", "term")], "evidence 'a': tables"),
        ([EvidenceColumn("a", "", "", main=True), EvidenceColumn("b", "", "", main=True)], "one main column"),
        ([EvidenceColumn("a", "", "", "term", main=True)], "one main column at most, per edge"),
    ],
)
def test_columns_that_tables_cannot_show_are_refused(columns, message):
    with pytest.raises(UserError, match=message):
        Discoverer("mine", _found({}), "", evidence=tuple(columns))


def test_samples_cost_nothing_unless_they_are_read_and_asking_for_others_says_so():
    def discover_stage(problem):
        problem.samples()

    with pytest.raises(UserError, match="'mine' asks for samples but registered `reads` as empty"):
        _run(Discoverer("mine", discover_stage, "", reads=frozenset()))


def test_what_needs_all_stages_is_decided_at_the_end():
    def finish(stages, settings):
        return [dataclasses.replace(s, matrix=~s.matrix, notes=(settings.discoverer,)) for s in stages]

    (stage,) = _run(Discoverer("mine", _found({}), "", finish=finish)).stages
    assert not stage.matrix.any()
    assert stage.notes == ("mine",)


def test_nothing_asks_for_the_papers_discoverer_or_its_evidence_by_name():
    """It is one among equals: no name of its tables stands outside its folder.

    Its own is that of the default, and of the rows of the method table that are the paper's whole method.
    """
    package = Path(causalbench.__file__).parent
    own = {"kl", *(column.name for column in DISCOVERERS["kl"].evidence)}
    found = set()
    for path in package.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            name = node.value if isinstance(node, ast.Constant) else getattr(node, "attr", None)
            if isinstance(name, str) and name in own:
                found.add((path.relative_to(package).as_posix(), name))
    outside = {pair for pair in found if "methods/kl/" not in pair[0]}
    assert outside == {("core/discovery/settings.py", "kl"), ("core/learners/methods.py", "kl")}


def test_listing_discoverers_imports_nothing_heavy():
    code = "import sys; from causalbench.core.discovery.discoverers import DISCOVERERS; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "causalbench.core.discovery.methods.cmi" in loaded
    assert {"torch", "numba", "pandas", "scipy.stats", "causallearn", "pydantic"}.isdisjoint(loaded)
