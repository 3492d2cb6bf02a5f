"""What a task is: names, terms and pure functions over `Facts`, single or with one batch dimension."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout, Workspace
from causalbench.core.world.scene import SceneSpec

Array = NDArray[np.float64]
CausalSets = Mapping[int, Mapping[str, frozenset[str]]]
"""stage (1-based) -> reward term -> the actions that cause it."""


class Expert(Protocol):
    """The scripted macro action (..., n_actions) that proves a task solvable.

    `layout` is the map it may plan on, one a world where `facts` are of several; without it, it takes the world for
    empty.
    """

    def __call__(self, facts: Facts, spec: SceneSpec, layout: Layout | Sequence[Layout] | None = None) -> Array:
        """A pure function, like all else of a task."""


def causal_sets(rows: Mapping[int, Mapping[str, str]]) -> CausalSets:
    """stage -> term -> actions in one string."""
    return {stage: {term: frozenset(actions.split()) for term, actions in row.items()} for stage, row in rows.items()}


def named_constants(module: Mapping[str, Any]) -> dict[str, float]:
    """The capitalised numbers among a module's globals, part of the task's identity."""
    return {
        name.lower(): value
        for name, value in module.items()
        if name.isupper() and (isinstance(value, float) or name == "HORIZON")
    }


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


@dataclass(frozen=True)
class Task:
    """A staged task. Stages are numbered from 1, as in the paper; all functions are pure.

    - `draw_layout(rng, workspace, max_opening, stage)`: a start inside `stage`, up to the caller's check of U(s);
    - `state_bounds(workspace)`: (low, high), each (n_state,) float64: where the state variables normally lie;
    - `observe(facts)`: state variables (..., n_state) in the paper's order, robot base frame;
    - `stage(facts)`: the paper's U(s), int (...), 1 to n_stages; memoryless, so it can go back;
    - `success(stage, now)`: bool (...), `stage` being U(s) before the step;
    - `rewards(previous, stage, action, now, next_stage)`: (..., n_terms), terms that are not active in `stage` =
      U(previous) are 0; call it through `stages.judge`, which computes each stage once;
    - `expert`: see `Expert`;
    - `requires`: scene capabilities without which the task cannot run. A task that requires "mobile_base" gets scenes
      that were made with `mobile=True`; what it requires of "lidar" becomes part of the observation;
    - `sensor`: what the paper's agents observe beside the state, a capability of the scene; "" for nothing.
    """

    name: str
    version: int
    env_id: str
    n_stages: int
    actions: tuple[str, ...]
    terms: tuple[Term, ...]
    state_names: tuple[str, ...]
    horizon: int  # control steps
    constants: Mapping[str, float]
    manual_graph: CausalSets
    draw_layout: Callable[[np.random.Generator, Workspace, float, int], Layout]
    state_bounds: Callable[[Workspace], tuple[Array, Array]]
    observe: Callable[[Facts], Array]
    stage: Callable[[Facts], NDArray[np.int64]]
    success: Callable[[NDArray[np.int64], Facts], NDArray[np.bool_]]
    rewards: Callable[[Facts, NDArray[np.int64], Array, Facts, NDArray[np.int64]], Array]
    expert: Expert
    requires: frozenset[str] = frozenset()
    sensor: Literal["", "rgb", "lidar"] = ""

    def sensor_in(self, observation: str) -> str:
        """The sensor that "state" or "paper" observes beside the state; "" for none."""
        return self.sensor if observation == "paper" else ""

    @property
    def term_names(self) -> tuple[str, ...]:
        """Names of the reward terms in vector order."""
        return tuple(term.name for term in self.terms)

    @property
    def camera(self) -> str:
        """The camera that shows people what happens, one of `cameras.find_camera`."""
        return "room" if "mobile_base" in self.requires else "scene"

    def stage_terms(self, stage: int, discoverable_only: bool = False) -> tuple[str, ...]:
        """Names of the terms of `stage` (1-based) in vector order."""
        return tuple(t.name for t in self.terms if stage in t.stages and (t.discoverable or not discoverable_only))
