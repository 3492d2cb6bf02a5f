"""The section on causes: per backend and stage what was discovered, what a human says, and what the oracle says."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import pandas as pd

from causalbench.core.discovery.graph import StageGraph
from causalbench.report.drawing import style
from causalbench.report.edge_scores import edge_scores
from causalbench.report.figures import draw_evidence, draw_graphs
from causalbench.report.frames import records
from causalbench.report.html.drawings import embedded
from causalbench.report.html.parts import (
    Column,
    Download,
    Fold,
    Matrix,
    Note,
    Picture,
    Pictures,
    Row,
    Section,
    Square,
    Table,
    Value,
)
from causalbench.report.html.source import Source
from causalbench.report.html.wording import NOTHING, column, count, listed, number, text
from causalbench.report.leaderboard import at_point
from causalbench.store.cells import StoredCell

EDGE = ["stage", "term", "action"]
LEAD = (
    "Which actions were found to cause which reward terms, beside what a human declared. Where the discoveries of "
    "several seeds differ, the cell says how many selected the edge; the matrix takes the majority. The oracle grades "
    "an edge by the share of the term's variance that the action causes, measured by restoring a state and repeating "
    "the step without the action: strong, weak, or absent."
)
STATES = {
    (True, True): ("both", "●", "discovered and declared"),
    (True, False): ("found", "+", "discovered, not declared by the human"),
    (False, True): ("human", "\N{MINUS SIGN}", "declared by the human, not discovered"),
    (False, False): ("neither", "", "neither discovered nor declared"),
}
"""(discovered, declared) -> state, symbol and words."""
GROUP = ["backend", "discoverer", "grid_point"]


class Group(NamedTuple):
    """Discoveries that differ in their seed alone."""

    backend: str
    discoverer: str
    grid_point: str

    @property
    def label(self) -> str:
        """Who discovered, and where."""
        return at_point(f"{self.backend}, {self.discoverer}", self.grid_point)


def section(source: Source) -> Section:
    """Matrices per backend, the agreement between backends, every edge with its numbers, and pictures."""
    groups = _groups(source.discoveries)
    if not groups:
        return Section("causes", "Causes", "", [Note("No causal graph was discovered in this run.")])
    edges = majority(source)
    blocks: list[Any] = []
    for group, cells in groups.items():
        blocks += [_matrix(edges, group, cells), *_differences(edges, group, cells)]
    blocks += [*_agreement(edges, list(groups)), *_scores(source), _edges(edges, groups, source)]
    blocks += [_pictures(group, cells[0], i) for i, (group, cells) in enumerate(groups.items())]
    return Section("causes", "Causes", LEAD, blocks)


def _groups(cells: Iterable[StoredCell]) -> dict[Group, list[StoredCell]]:
    found: dict[Group, list[StoredCell]] = {}
    for cell in cells:
        found.setdefault(Group(cell.backend, cell.discoverer, cell.grid_point), []).append(cell)
    return found


def majority(source: Source) -> pd.DataFrame:
    """One row per group and edge: `selected` of `seeds` discoveries, and what the `human` says.

    Numbers are medians over seeds; `grade` is the oracle's, or several with slashes where seeds differ.
    """
    table = source.tables.discovery.astype({"stage": int})
    human = pd.concat([_declared(cells[0]) for cells in _groups(source.discoveries).values()])
    by = [*GROUP, *EDGE]
    groups = table.groupby(by, sort=False)
    found = groups["selected"].agg(["sum", "size"]).rename(columns={"sum": "selected", "size": "seeds"})
    found["undecided"] = groups["outcome"].agg(lambda outcomes: int((outcomes == "undecided").sum()))
    numbers = ["oracle_effect", "oracle_effect_low", "oracle_effect_high"]
    told = table.assign(**{name: pd.to_numeric(table[name], errors="coerce") for name in numbers}).groupby(
        by, sort=False
    )
    found = found.join(told[numbers].median())
    found["grade"] = groups["oracle_grade"].agg(lambda grades: "/".join(sorted(set(grades.dropna()))))
    return found.reset_index().merge(human, on=by)


def _declared(cell: StoredCell) -> pd.DataFrame:
    rows = [
        (cell.backend, cell.discoverer, cell.grid_point, stage.stage, term, action, bool(stage.matrix[k, j]))
        for stage in cell.human_graph().stages
        for j, term in enumerate(stage.terms)
        for k, action in enumerate(stage.actions)
    ]
    return pd.DataFrame(rows, columns=[*GROUP, *EDGE, "human"])


def is_found(row: Any) -> bool:
    """Whether more than half of the discoveries selected the edge."""
    return bool(2 * row["selected"] > row["seeds"])


def _matrix(edges: pd.DataFrame, group: Group, cells: Sequence[StoredCell]) -> Matrix:
    graph = cells[0].graph()
    rows = {tuple(row[key] for key in EDGE): row for row in records(_of(edges, group))}
    columns = [(stage.stage, term) for stage in graph.stages for term in stage.terms]
    lines = [
        (action, [_square(rows[stage, term, action], graph.stages[stage - 1]) for stage, term in columns])
        for action in graph.stages[0].actions
    ]
    stages = [(stage.stage, len(stage.terms)) for stage in graph.stages]
    return Matrix(group.label, stages, [term for _, term in columns], lines, group.backend, _how(cells))


def _how(cells: Sequence[StoredCell]) -> str:
    """Who discovered it, from which seeds, at which price."""
    graphs = [cell.graph() for cell in cells]
    price = listed(number(graph.env_steps, 0).text for graph in graphs)
    seeds = listed(str(cell.seed) for cell in cells)
    many = count(len(cells), "discovery", "discoveries")
    return f"{many}, seed {seeds}; price in environment steps: {price}."


def _group(row: Mapping[str, Any]) -> Group:
    return Group(*(row[name] for name in GROUP))


def _of(edges: pd.DataFrame, group: Group) -> pd.DataFrame:
    return edges[(edges[GROUP] == list(group)).all(axis=1)]


def _square(row: dict[str, Any], stage: StageGraph) -> Square:
    state, symbol, words = STATES[is_found(row), bool(row["human"])]
    untested = stage.testable is not None and not stage.testable[stage.terms.index(row["term"])]
    split = f"{row['selected']}/{row['seeds']}" if 0 < row["selected"] < row["seeds"] else ""
    grade = row["grade"] or ""
    mark, shown = "?" if row["undecided"] else "", grade != "absent" or state in ("both", "found")
    more = " ".join(filter(None, [split, mark, grade if shown else ""]))
    sentence = f"{row['action']} on {row['term']}, stage {row['stage']}: {words}"
    sentence += f", selected by {row['selected']} of {row['seeds']}" + (f", oracle: {grade}" if grade else "")
    sentence += f"; undecided in {row['undecided']}" if row["undecided"] else ""
    sentence += "; the term never varied, so the declared causes stand" if untested else ""
    return Square("untested" if untested else state, symbol, more, sentence)


def _differences(edges: pd.DataFrame, group: Group, cells: Sequence[StoredCell]) -> list[Any]:
    """Where discovery and the human differ, in words, and what discovery had to say."""
    rows = records(_of(edges, group))
    differing = [row for row in rows if is_found(row) != bool(row["human"])]
    added = [_edge(row) for row in differing if is_found(row)]
    missing = [_edge(row) for row in differing if not is_found(row)]
    said = [f"discovered and not declared: {listed(added)}"] if added else []
    said += [f"declared and not discovered: {listed(missing)}"] if missing else []
    where = group.label
    exact = sum(_same(cell) for cell in cells)
    each = f" Of {count(len(cells), 'discovery', 'discoveries')}, {exact} equal it edge by edge."
    notes = [
        Note(
            f"{where} differs from the human's graph in {len(differing)} of {len(rows)} edges; "
            + "; ".join(said)
            + "."
            + each
        )
    ]
    if not differing:
        notes = [Note(f"{where}: discovered and declared causes are the same, all {len(rows)} edges.{each}")]
    told = [
        f"Seed {cell.seed}, stage {stage.stage}: {note}."
        for cell in cells
        for stage in cell.graph().stages
        for note in stage.notes
    ]
    title = f"{count(len(told), 'reservation')} of the discovery itself, {where}"
    return [*notes, *([Fold(title, [Note(sentence) for sentence in told])] if told else [])]


def _same(cell: StoredCell) -> bool:
    """Whether a discovery is the human's graph."""
    pairs = zip(cell.graph().stages, cell.human_graph().stages, strict=True)
    return all(bool((found.matrix == human.matrix).all()) for found, human in pairs)


def _edge(row: dict[str, Any]) -> str:
    oracle = f", oracle: {row['grade']}" if row["grade"] else ""
    return f"{row['action']} → {row['term']} (stage {row['stage']}{oracle})"


def _agreement(edges: pd.DataFrame, groups: Sequence[Group]) -> list[Table]:
    if len(groups) < 2:
        return []
    found = {g: {tuple(row[key] for key in EDGE): is_found(row) for row in records(_of(edges, g))} for g in groups}
    rows = []
    for one, other in combinations(groups, 2):
        shared = found[one].keys() & found[other].keys()
        same = sum(found[one][edge] == found[other][edge] for edge in shared)
        differing = [
            f"{action} → {term} (stage {stage})"
            for stage, term, action in sorted(shared)
            if found[one][stage, term, action] != found[other][stage, term, action]
        ]
        share = Value(f"{same} of {len(shared)}", same / len(shared) if shared else 0.0)
        rows.append(Row([text(one.label), text(other.label), share, text(listed(differing) or "none")]))
    columns = [Column("one"), Column("other"), Column("edges that agree", "", True), Column("edges that differ")]
    return [Table("Agreement between discoveries, majority of each", columns, rows)]


def _scores(source: Source) -> list[Table]:
    table = source.tables.discovery
    if not table["oracle_grade"].notna().any():
        return []
    plain = table.astype({"oracle_grade": object, "selected": int})
    whole = edge_scores(plain, GROUP).reset_index().assign(stage="all")
    stages = edge_scores(plain, [*GROUP, "stage"]).reset_index()
    rows = [
        Row(
            [
                text(_group(row).label), Value(str(row["stage"]), str(row["stage"])),
                number(row["seeds"], 0), number(row["precision"]), number(row["recall"]), number(row["f1"]),
                number(row["missed"], 0), number(row["false"], 0),
            ],
            row["backend"],
        )
        for row in records(pd.concat([whole, stages]))
    ]  # fmt: skip
    columns = [
        Column("backend"), column("stage"), column("seeds"), column("precision"), column("recall"), column("f1", "F1"),
        Column("missed", "Strong edges that were not selected, over all seeds.", True),
        Column("false", "Absent edges that were selected, over all seeds.", True),
    ]  # fmt: skip
    return [Table("Against the oracle: strong and absent edges, weak ones left out", columns, rows)]


def _edges(edges: pd.DataFrame, groups: dict[Group, list[StoredCell]], source: Source) -> Fold:
    found = source.tables.discovery.astype({"stage": int}).groupby([*GROUP, *EDGE])
    mains = {group: cells[0].graph().main_column for group, cells in groups.items()}
    columns = [
        Column("backend"), column("stage"), column("term", numeric=False), column("action", numeric=False),
        Column("selected", "How many of the discoveries selected the edge.", True), Column("declared"),
        column("oracle_grade", "oracle", numeric=False), column("oracle_effect", "effect [95%]"),
        Column("evidence", "Median [least, most] over discoveries of the number that the discoverer decides by.", True),
    ]  # fmt: skip
    rows = []
    for row in records(edges):
        group = _group(row)
        key, main = (*group, *(row[name] for name in EDGE)), mains[group]
        rows.append(
            Row(
                [
                    text(group.label), number(row["stage"], 0), text(row["term"]), text(row["action"]),
                    Value(f"{row['selected']} of {row['seeds']}", row["selected"] / row["seeds"]),
                    text("yes" if row["human"] else "no"), text(row["grade"]), _effect(row),
                    _evidence(found.get_group(key)[main.name], main.name) if main else NOTHING,
                ],
                row["backend"],
            )
        )  # fmt: skip
    return Fold(
        "Every edge, with its numbers",
        [Table("Edges", columns, rows, Download.csv("discovery.csv", source.tables.discovery))],
    )


def _effect(row: dict[str, Any]) -> Value:
    if row["oracle_effect"] is None:
        return NOTHING
    return Value(
        f"{row['oracle_effect']:.4f} [{row['oracle_effect_low']:.4f}, {row['oracle_effect_high']:.4f}]",
        row["oracle_effect"],
    )


def _evidence(found: pd.Series, name: str) -> Value:
    """Median and range of the column `name` over the discoveries of one edge."""
    values = found.dropna().astype(float)
    if values.empty:
        return NOTHING
    span = f" [{values.min():.3g}, {values.max():.3g}]" if len(values) > 1 else ""
    return Value(f"{name} {values.median():.3g}{span}", float(values.median()))


def _pictures(group: Group, cell: StoredCell, index: int) -> Fold:
    """The paper's pictures of one discovery."""
    graph, human = cell.graph(), cell.human_graph()
    where = f"{group.label}, seed {cell.seed}"
    edges = listed(
        f"{a} → {t}"
        for s in graph.stages
        for j, t in enumerate(s.terms)
        for k, a in enumerate(s.actions)
        if s.matrix[k, j]
    )
    with style():
        drawn = [(draw_graphs(graph, human), f"Causal graph of {where} beside the human's: {edges}.")]
        if (main := graph.main_column) and any(main.name in stage.evidence for stage in graph.stages):
            drawn.insert(
                0, (draw_evidence(graph, main), f"{main.name} of every action and term, {where}; selected: {edges}.")
            )
        found = [
            Picture(
                embedded(figure, f"graph-{index}-{i}", alt, transparent=False), alt, "", group.backend, "", paper=True
            )
            for i, (figure, alt) in enumerate(drawn)
        ]
    sentence = f"{main.name}: {main.sentence}." if main else ""
    return Fold(f"Pictures of one discovery: {where}", [Pictures("", found, sentence, backend=group.backend)])
