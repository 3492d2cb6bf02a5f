"""Pictures of causal graphs: what must be in them, whatever they look like."""

import dataclasses
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from causalbench.core.discovery.graph import CausalGraph, EvidenceColumn, StageGraph, manual_graph
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.report.figures import write_figures

SVG = "{http://www.w3.org/2000/svg}"


def discovered(
    human: CausalGraph, select, testable=lambda n: np.ones(n, dtype=bool), log_range=(1e-4, 12.5)
) -> CausalGraph:
    rng = np.random.default_rng(0)
    stages = []
    for stage in human.stages:
        kl = 10.0 ** rng.uniform(-6, 2, stage.matrix.shape)
        can = testable(len(stage.terms))
        stages.append(dataclasses.replace(stage, matrix=select(kl), evidence={"kl": kl}, testable=can))
    columns = (EvidenceColumn("kl", "nats", "divergence", main=True, log_range=log_range),)
    return dataclasses.replace(human, origin="discovered", stages=tuple(stages), columns=columns)


def long_names() -> CausalGraph:
    actions = ("an_action_with_a_long_name", "<&>")
    stage = StageGraph(1, actions, ("r_distance_of_the_base_to_its_goal",), np.ones((2, 1), dtype=bool))
    return CausalGraph("long", 0, "manual", (stage,))


GRAPHS = {
    "usual": discovered(manual_graph(TASK), lambda kl: kl > 1.0),
    "untestable": discovered(manual_graph(TASK), lambda kl: kl > 1.0, lambda n: np.arange(n) == 0),
    "nothing testable": discovered(long_names(), lambda kl: kl >= 0.0, lambda n: np.zeros(n, dtype=bool)),
    "linear": discovered(manual_graph(TASK), lambda kl: kl > 1.0, log_range=None),
    "long names": discovered(long_names(), lambda kl: np.zeros_like(kl, dtype=bool)),
}


@pytest.mark.parametrize("name", GRAPHS)
def test_pictures_show_every_name_and_frame_what_is_selected(name, tmp_path):
    graph = GRAPHS[name]
    human = long_names() if graph.task == "long" else manual_graph(TASK)
    write_figures(tmp_path / "figures", graph, human)
    chosen = {
        f"{stage.stage}-{stage.terms[j]}-{stage.actions[k]}"
        for stage in graph.stages
        for k, j in zip(*stage.matrix.nonzero(), strict=True)
    }
    names = {*graph.stages[0].actions, *(term for stage in graph.stages for term in stage.terms)}
    assert {p.name for p in (tmp_path / "figures").iterdir()} == {
        f"{picture}.{kind}" for picture in ("evidence", "matrix", "graph") for kind in ("svg", "png")
    }
    for picture in ("evidence", "matrix"):
        root = ElementTree.parse(tmp_path / "figures" / f"{picture}.svg").getroot()
        assert names <= {text.text for text in root.iter(f"{SVG}text")}
        marked = [group.get("id") for group in root.iter(f"{SVG}g")]
        assert {i.removeprefix("selected-") for i in marked if i and i.startswith("selected-")} == chosen
    root = ElementTree.parse(tmp_path / "figures" / "graph.svg").getroot()
    assert names <= {text.text for text in root.iter(f"{SVG}text")}
    edges = [g.get("id") for g in root.iter(f"{SVG}g") if (g.get("id") or "").startswith("edge-")]
    assert len(edges) == len(chosen) + sum(int(stage.matrix.sum()) for stage in human.stages)


def test_the_same_graph_gives_the_same_bytes(tmp_path):
    for folder in ("one", "two"):
        write_figures(tmp_path / folder, GRAPHS["long names"], long_names())
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()


def test_a_graph_without_evidence_has_no_heat_map(tmp_path):
    write_figures(tmp_path / "figures", manual_graph(TASK), manual_graph(TASK))
    assert {p.stem for p in (tmp_path / "figures").iterdir()} == {"matrix", "graph"}
