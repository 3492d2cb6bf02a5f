"""What learners, discovery and tables know of a staged task: names, numbers and the human's causal graph."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from causalbench.errors import UserError

CausalSets = Mapping[int, Mapping[str, frozenset[str]]]
"""stage (1-based) -> reward term -> the actions that cause it."""
Sensor = Literal["", "rgb", "lidar"]
FEATURE_BOUND = 5.0
"""Features beyond it, either way, are clipped to it."""


def causal_sets(rows: Mapping[int, Mapping[str, str]]) -> CausalSets:
    """Make causal sets of rows in which the actions are one string: `{1: {"r_eefx": "armx army"}}`."""
    return {stage: {term: frozenset(actions.split()) for term, actions in row.items()} for stage, row in rows.items()}


def base_name(name: str) -> str:
    """The name of the registered task that the task `name` is a change of, see `changes`; else `name` itself."""
    return name.partition("+")[0]


def by_name(record: Any) -> dict[str, Any]:
    """Return the fields of a named tuple as a dict, also of those within it: data for `StageTask.constants`."""
    fields: dict[str, Any] = record._asdict()
    return {name: by_name(value) if hasattr(value, "_asdict") else value for name, value in fields.items()}


@dataclass(frozen=True)
class Term:
    """One named reward term: the stages it belongs to (1-based) and whether causal discovery may use it.

    A term that discovery may not use (collisions, the stage bonus) gets an all-ones column in training
    (paper, Reward Setting and section Mobile Manipulation Task).
    """

    name: str
    stages: tuple[int, ...]
    discoverable: bool
    description: str


@dataclass(frozen=True, kw_only=True)
class StageTask:
    """The data that every staged task has. `Task` and `GymTask` add functions. Stages are numbered from 1.

    - `constants`: every number that can change a result, by name, of any type that JSON has; tuples are lists to it;
    - `state_names`: the variables that policies observe;
    - `horizon`: control steps of an episode;
    - `manual_graph`: the causal graph that a human wrote down; may be empty or name some stages and terms only;
    - `paper_sensor`: what the paper's agents observe beside the state, a capability of the world; "" for nothing;
    - `potential(state, stage)`: how far along the task is, (...) from 0 up, from the observed state (..., n_state) and
      U(s) (...), from 1; None where there is none. It stands for the terms of `potential_terms` where a learner climbs
      one reward: see `causalbench.core.learners.scalars`;
    - `features(state)`: numbers (..., n_features) that are named in `feature_names`, computed from the state variables
      (..., n_state) alone, at a scale at which the task's tolerances are visible to a network. Learners and models of
      the rewards see them beside the state. None where there are none;
    - `reverse_share`: by action, the share at which a value below 0 is executed, where that is not all of it.

    Raises `UserError` for a name or a stage that does not exist.
    """

    name: str
    version: int
    env_id: str
    n_stages: int
    actions: tuple[str, ...]
    terms: tuple[Term, ...]
    state_names: tuple[str, ...]
    horizon: int
    constants: Mapping[str, Any]
    manual_graph: CausalSets
    paper_sensor: Sensor = ""
    potential: Callable[[NDArray[Any], NDArray[Any]], NDArray[Any]] | None = None
    potential_terms: tuple[str, ...] = ()
    features: Callable[[NDArray[Any]], NDArray[Any]] | None = None
    feature_names: tuple[str, ...] = ()
    reverse_share: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if bool(self.features) != bool(self.feature_names):
            raise UserError(f"task {self.name!r}: `features` and `feature_names` must be given together")
        inputs = self.state_names + self.feature_names
        if len({*inputs}) < len(inputs):
            raise UserError(f"task {self.name!r}: state_names, feature_names: expected each name once, got {inputs}")
        for kind, names in (("actions", self.actions), ("terms", self.term_names), ("state_names", self.state_names)):
            if not names or len(set(names)) < len(names):
                raise UserError(f"task {self.name!r}: {kind}: expected at least one name, each once, got {names}")
        for term in self.terms:
            if not term.stages or not set(term.stages) <= {*range(1, self.n_stages + 1)}:
                raise UserError(f"task {self.name!r}: term {term.name!r}: stages {term.stages} of 1 to {self.n_stages}")
        for stage, row in self.manual_graph.items():
            unknown = {*row} - {*self.stage_terms(stage)} | {*frozenset().union(*row.values())} - {*self.actions}
            if unknown:
                raise UserError(f"task {self.name!r}: manual_graph: stage {stage} has no {', '.join(sorted(unknown))}")
        if bool(self.potential) != bool(self.potential_terms) or not {*self.potential_terms} <= {*self.term_names}:
            raise UserError(
                f"task {self.name!r}: `potential` and `potential_terms`, some of {', '.join(self.term_names)}, must be "
                "given together"
            )
        if not {*self.reverse_share} <= {*self.actions} or not all(0 < s <= 1 for s in self.reverse_share.values()):
            raise UserError(
                f"task {self.name!r}: reverse_share: expected shares in (0, 1] of {', '.join(self.actions)}"
            )

    def sensor_in(self, observation: str) -> Sensor:
        """The sensor that `observation` observes as it is beside the state; "" for none."""
        return self.paper_sensor if observation == "paper" else ""

    @property
    def term_names(self) -> tuple[str, ...]:
        """Names of the reward terms in vector order."""
        return tuple(term.name for term in self.terms)

    def executed(self, actions: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the worlds execute of `actions` (..., n_actions); 0 stays 0."""
        if not self.reverse_share:
            return actions
        share = np.array([self.reverse_share.get(name, 1.0) for name in self.actions])
        return np.where(actions < 0.0, actions * share, actions)

    def input_names(self, features: bool, sectors: bool = False) -> tuple[str, ...]:
        """Names of all that a model of the rewards sees of a state: `Worlds.states`, with what was chosen for it."""
        return self.state_names + (self.feature_names if features else ())

    def features_of(self, state: NDArray[Any]) -> NDArray[np.float32]:
        """The features (..., n_features) of state variables (..., n_state), within `FEATURE_BOUND`."""
        found = self.features(state) if self.features else np.zeros((*state.shape[:-1], 0))
        return np.minimum(np.maximum(found, -FEATURE_BOUND), FEATURE_BOUND).astype(np.float32)

    def stage_terms(self, stage: int, discoverable_only: bool = False) -> tuple[str, ...]:
        """Names of the terms of `stage` (1-based) in vector order."""
        return tuple(t.name for t in self.terms if stage in t.stages and (t.discoverable or not discoverable_only))
