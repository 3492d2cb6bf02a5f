"""Mask controls: spoilt matrices that tell what a causal matrix says from how sparse it is.

Each differs from the matrix it comes from in one thing, and leaves every stage solvable by the scripted expert
restricted to its actions: a control that cannot be solved proves nothing. What is drawn depends on the seed, so that
several seeds try several draws. An action that enters gets every term of the stage, like a false discovery.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.graph import CausalGraph, StageGraph
from causalbench.core.staged.restricted_expert import STARTS, solved_starts
from causalbench.core.staged.worlds import Worlds
from causalbench.errors import InvalidGraphError

Matrix = NDArray[np.bool_]  # (n_actions, n_terms)
FIRST_LOOK = 4  # starts after which most unsolvable sets are known
DRAWS = 100  # after which a stage counts as one that has no such control


def shuffled(matrix: Matrix, rng: np.random.Generator) -> Iterator[Matrix]:
    """The rows of the causal actions dealt out anew among them: the same sparsity, another meaning."""
    causal = np.flatnonzero(matrix.any(1))
    for _ in range(DRAWS):
        changed = matrix.copy()
        changed[causal] = matrix[rng.permutation(causal)]
        if (changed != matrix).any():
            yield changed


def redrawn(matrix: Matrix, rng: np.random.Generator) -> Iterator[Matrix]:
    """As many edges, anywhere between the causal actions and the terms, each action with at least one."""
    causal = np.flatnonzero(matrix.any(1))
    n_terms = matrix.shape[1]
    for _ in range(DRAWS):
        changed = np.zeros_like(matrix)
        changed[causal, rng.integers(n_terms, size=len(causal))] = True
        free = np.argwhere(~changed[causal])
        for row, column in rng.permutation(free)[: matrix.sum() - len(causal)]:
            changed[causal[row], column] = True
        if (changed != matrix).any():
            yield changed


def with_extra_actions(count: int) -> Callable[[Matrix, np.random.Generator], Iterator[Matrix]]:
    """The causal actions plus `count` others (all others, where there are fewer)."""

    def control(matrix: Matrix, rng: np.random.Generator) -> Iterator[Matrix]:
        changed = matrix.copy()
        changed[rng.permutation(np.flatnonzero(~matrix.any(1)))[:count]] = True
        yield changed

    return control


def other(matrix: Matrix, rng: np.random.Generator) -> Iterator[Matrix]:
    """Every other set of as many actions; those of the causal ones that stay keep their rows."""
    causal = set(np.flatnonzero(matrix.any(1)).tolist())
    sets = [chosen for chosen in combinations(range(len(matrix)), len(causal)) if set(chosen) != causal]
    for index in rng.permutation(len(sets)):
        changed = np.zeros_like(matrix)
        for action in sets[index]:
            changed[action] = matrix[action] if action in causal else True
        yield changed


CONTROLS: Mapping[str, Callable[[Matrix, np.random.Generator], Iterator[Matrix]]] = {
    "shuffled": shuffled,
    "redrawn": redrawn,
    "plus1": with_extra_actions(1),
    "plus2": with_extra_actions(2),
    "other": other,
}
"""Name -> function of a stage's matrix that yields candidates, the first solvable one of which is taken."""


def control_graph(name: str, graph: CausalGraph, worlds: Worlds, seed: int) -> CausalGraph:
    """The control `name` of `graph`, deterministic in `seed`.

    A stage that has no such control (one action has no rows to shuffle, and only `grip` can grasp) keeps its matrix;
    `provenance` lists the stages that changed. Raises `InvalidGraphError` when none did, or when the graph's own
    actions do not solve a stage.
    """
    stages, changed = [], []
    allowed = {own.stage: own.policy_actions() for own in graph.stages}

    @cache
    def solvable(stage: int, actions: tuple[str, ...]) -> bool:
        sets = allowed | {stage: actions}
        return all(solved_starts(worlds, stage, sets, starts).all() for starts in (FIRST_LOOK, STARTS))

    for own in graph.stages:
        rng = np.random.default_rng([seed, own.stage])
        if not solvable(own.stage, own.policy_actions()):
            raise InvalidGraphError(
                f"causal graph {graph.hash}, stage {own.stage}: the scripted expert cannot solve the stage with "
                f"{' '.join(own.policy_actions())} alone, so no control of it would prove anything; discover again"
            )
        set_by_policy = np.isin(own.actions, own.policy_actions())
        for matrix in CONTROLS[name](own.causes & set_by_policy[:, None], rng):
            candidate = StageGraph(own.stage, own.actions, own.terms, matrix)
            if solvable(own.stage, candidate.causal_actions()):
                changed.append(own.stage)
                stages.append(candidate)
                allowed[own.stage] = candidate.causal_actions()
                break
        else:
            stages.append(own)
    if not changed:
        raise InvalidGraphError(f"causal graph {graph.hash} has no control {name!r}: no stage can be changed")
    provenance = {"control": name, "of": graph.hash, "seed": seed, "changed_stages": changed}
    return dataclasses.replace(graph, origin="control", stages=tuple(stages), provenance=provenance)
