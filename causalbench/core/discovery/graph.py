"""The CausalGraph artefact: which actions cause which reward terms, per stage, with where it came from and a hash."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from causalbench import formats
from causalbench.core.tasks.stage_task import StageTask
from causalbench.errors import InvalidGraphError

Outcome = Literal["present", "absent", "undecided"]
"""What discovery says of an edge. Undecided: the evidence allows neither of the others at the stated error."""
UndecidedAs = Literal["present", "absent"]


@dataclass(frozen=True)
class EvidenceColumn:
    """Describes an array of numbers by which a discoverer decides, or which explain its decision.

    `unit` may be ""; `sentence` says what the number is. `per` says of what there is one: of an edge, an array
    (n_actions, n_terms); of a term, an array (n_terms,); "stage" stands for an array of any shape, which the graph
    keeps and no table shows. The `main` column, one per edge, is what pictures and the terminal show; its colours go
    logarithmically from the first to the second number of `log_range`, without one linearly over what there is.
    """

    name: str
    unit: str
    sentence: str
    per: Literal["edge", "term", "stage"] = "edge"
    main: bool = False
    log_range: tuple[float, float] | None = None


@dataclass(frozen=True)
class StageGraph:
    """The causal matrix of one stage, with actions as rows and reward terms as columns, and the evidence behind it.

    `evidence` holds what the discoverer decided by, as `CausalGraph.columns` describes it; it is empty where nothing
    could be decided. A term whose reward never varied is untestable: its column is that of the task's declared graph.
    `sufficient` names the causes that a policy is built on, where a discoverer found that fewer than all do. `notes`
    says in sentences what did not go as planned.

    An edge is present where `matrix` is True, undecided where `undecided` is, and absent elsewhere. A learner takes an
    undecided edge for what `undecided_as` says.
    """

    stage: int
    actions: tuple[str, ...]
    terms: tuple[str, ...]
    matrix: NDArray[np.bool_]  # (n_actions, n_terms)
    testable: NDArray[np.bool_] | None = None  # (n_terms,); None: all
    evidence: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    sufficient: tuple[str, ...] | None = None  # None: all causes
    notes: tuple[str, ...] = ()
    undecided: NDArray[np.bool_] | None = None  # (n_actions, n_terms); None: every edge is decided
    undecided_as: UndecidedAs = "present"

    @classmethod
    def decided(
        cls,
        task: StageTask,
        stage: int,
        present: NDArray[np.bool_],
        testable: NDArray[np.bool_],
        evidence: Mapping[str, NDArray[np.float64]],
        notes: tuple[str, ...] = (),
        undecided: NDArray[np.bool_] | None = None,
    ) -> StageGraph:
        """Make the graph of a stage from the edges that are `present`, bool (n_actions, n_terms).

        A term that is not `testable`, bool (n_terms,), gets its column from the task's manual graph. `evidence` holds
        the arrays that the discoverer describes. An edge that is `undecided`, bool (n_actions, n_terms), must not be
        present.
        """
        terms = task.stage_terms(stage, discoverable_only=True)
        matrix = np.where(testable, present, declared_matrix(task, stage, terms))
        still = None if undecided is None else undecided & testable
        return cls(stage, task.actions, terms, matrix, testable, evidence, notes=notes, undecided=still)

    @property
    def left_open(self) -> NDArray[np.bool_]:
        """(n_actions, n_terms) whether an edge is undecided."""
        return np.zeros_like(self.matrix) if self.undecided is None else self.undecided

    @property
    def causes(self) -> NDArray[np.bool_]:
        """(n_actions, n_terms) what a learner takes for causes: present edges, and undecided ones by `undecided_as`."""
        return self.matrix | self.left_open if self.undecided_as == "present" else self.matrix

    def outcome(self, action: int, term: int) -> Outcome:
        """What was decided of the edge of the action and the term with these numbers."""
        if self.matrix[action, term]:
            return "present"
        return "undecided" if self.left_open[action, term] else "absent"

    def causal_actions(self) -> tuple[str, ...]:
        """Actions that a learner takes for a cause of some term, in order (paper, eq. CausalActions)."""
        return tuple(a for a, row in zip(self.actions, self.causes, strict=True) if row.any())

    def problem(self, task: StageTask) -> str:
        """Why no policy of `task` can be built on the stage's graph; "" if one can."""
        if self.actions != task.actions or self.terms != task.stage_terms(self.stage, discoverable_only=True):
            return "actions or terms differ from the task's"
        causal = self.causal_actions()
        if not set(self.policy_actions()) <= set(causal) or self.sufficient == ():
            return f"the sufficient actions {self.sufficient} are not some of its causal actions {causal}"
        if not self.causes.any():
            return "no action causes any reward, so no policy can be built; discover again with more samples"
        return ""

    def policy_actions(self) -> tuple[str, ...]:
        """The causal actions that a policy sets; the others stay at 0."""
        return self.causal_actions() if self.sufficient is None else self.sufficient


@dataclass(frozen=True)
class CausalGraph:
    """A causal graph: one `StageGraph` per stage. `provenance` holds settings, seed, data hash and versions.

    `columns` describes the evidence of the stages, in the order of tables.
    `env_steps` counts every environment step that discovery took; 0 for a declared graph. `oracle` is empty, or how the
    graph stands against the truth (`score.with_score`): ground truth, so its env steps are no cost of discovery.
    """

    task: str
    task_version: int
    origin: Literal["discovered", "manual", "oracle", "control"]
    stages: tuple[StageGraph, ...]
    env_steps: int = 0
    provenance: Mapping[str, Any] = field(default_factory=dict)
    oracle: Mapping[str, Any] = field(default_factory=dict)
    columns: tuple[EvidenceColumn, ...] = ()

    @property
    def hash(self) -> str:
        """First 16 hex digits of the SHA-256 of the canonical JSON of everything in the graph."""
        return hashlib.sha256(_canonical(self._content()).encode()).hexdigest()[:16]

    def _content(self) -> dict[str, Any]:
        return {"schema": formats.GRAPH} | dataclasses.asdict(self)

    def to_json(self) -> str:
        """JSON text whose `hash` key is that of the rest."""
        return _canonical(self._content() | {"hash": self.hash}, indent=1)

    @property
    def main_column(self) -> EvidenceColumn | None:
        """The column that pictures and the terminal show; None if the discoverer named none."""
        return next((column for column in self.columns if column.main), None)

    @classmethod
    def load(cls, path: Path) -> CausalGraph:
        """The graph in the file `path`; raises as `from_json`, and `InvalidGraphError` when it cannot be read."""
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise InvalidGraphError(f"{path}: cannot be read ({error}); run `causalbench discover`") from error
        return cls.from_json(text, path)

    @classmethod
    def from_json(cls, text: str, source: Path | str = "causal graph") -> CausalGraph:
        """The graph in `text`. Raises `InvalidGraphError` when it is none or its hash does not match its content."""
        try:
            data = json.loads(text)
            claimed = data.pop("hash")
            if data.pop("schema") != formats.GRAPH:
                raise InvalidGraphError(f"{source}: made by another version of causalbench; run discovery again")
            data["stages"] = tuple(_stage_graph(stage) for stage in data["stages"])
            data["columns"] = tuple(map(_column, data["columns"]))
            graph = cls(**data)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InvalidGraphError(f"{source}: not a causal graph ({error!r}); run `causalbench discover`") from error
        if graph.hash != claimed:
            raise InvalidGraphError(
                f"{source}: content hash {graph.hash} differs from the recorded {claimed}; was it edited?"
            )
        return graph

    def check(self, task: StageTask) -> None:
        """Raise `InvalidGraphError` unless the graph fits `task`: names, order and no stage without a causal action.

        Nor may a discovered graph be the declared one throughout, because no stage could be decided.
        """
        if (self.task, self.task_version) != (task.name, task.version):
            raise InvalidGraphError(
                f"causal graph {self.hash} is for {self.task} v{self.task_version}, not {task.name} v{task.version}"
            )
        if [g.stage for g in self.stages] != list(range(1, task.n_stages + 1)):
            raise InvalidGraphError(f"causal graph {self.hash} has stages {[g.stage for g in self.stages]}")
        if self.origin == "discovered" and not any(g.testable is None or g.testable.any() for g in self.stages):
            raise InvalidGraphError(
                f"causal graph {self.hash}: discovery could decide nothing: "
                + "; ".join(note for graph in self.stages for note in graph.notes)
            )
        for graph in self.stages:
            if problem := graph.problem(task):
                raise InvalidGraphError(f"causal graph {self.hash}, stage {graph.stage}: {problem}")


def manual_graph(task: StageTask) -> CausalGraph:
    """The human's graph, declared by the task."""
    return CausalGraph(
        task.name,
        task.version,
        "manual",
        tuple(
            StageGraph(stage, task.actions, terms, declared_matrix(task, stage, terms))
            for stage in range(1, task.n_stages + 1)
            for terms in [task.stage_terms(stage, discoverable_only=True)]
        ),
    )


def declared_matrix(task: StageTask, stage: int, terms: tuple[str, ...]) -> NDArray[np.bool_]:
    """(n_actions, n_terms) matrix of the human's graph for one stage, False where it says nothing."""
    row = task.manual_graph.get(stage, {})
    return np.array([[action in row.get(term, ()) for term in terms] for action in task.actions])


def _stage_graph(data: dict[str, Any]) -> StageGraph:
    names = {k: tuple(data[k]) for k in ("actions", "terms", "notes", "sufficient") if data[k] is not None}
    arrays = {k: np.array(v) for k, v in data.items() if isinstance(v, list) and k not in names}
    evidence = {k: np.array(v) for k, v in data["evidence"].items()}
    return StageGraph(**(data | arrays | names | {"evidence": evidence}))


def _column(data: dict[str, Any]) -> EvidenceColumn:
    return EvidenceColumn(**(data | {"log_range": data["log_range"] and tuple(data["log_range"])}))


def _canonical(content: Any, indent: int | None = None) -> str:
    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return value.tolist()
        if isinstance(value, np.generic):
            return value.item()
        raise TypeError(f"{type(value).__name__} has no place in a causal graph")

    return json.dumps(content, default=plain, sort_keys=True, indent=indent, allow_nan=False)
