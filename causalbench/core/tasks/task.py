"""What a task is: names, terms and pure functions over `Facts`, single or with one batch dimension."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from causalbench.core.layout import Layout, Workspace
from causalbench.core.scene import Facts, SceneSpec

Array = NDArray[np.float64]
CausalSets = Mapping[int, Mapping[str, frozenset[str]]]
"""stage (1-based) -> reward term -> the actions that cause it."""


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
    - `expert(facts, spec)`: the scripted macro action (..., n_actions) that proves the task solvable;
    - `requires`: scene capabilities without which the task cannot run.
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
    expert: Callable[[Facts, SceneSpec], Array]
    requires: frozenset[str] = frozenset()

    @property
    def term_names(self) -> tuple[str, ...]:
        """Names of the reward terms in vector order."""
        return tuple(term.name for term in self.terms)

    def stage_terms(self, stage: int, discoverable_only: bool = False) -> tuple[str, ...]:
        """Names of the terms of `stage` (1-based) in vector order."""
        return tuple(t.name for t in self.terms if stage in t.stages and (t.discoverable or not discoverable_only))
