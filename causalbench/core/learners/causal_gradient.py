"""From a stage's causal matrix to what its learner needs: actions, critics and masks (paper, Causal Policy Gradient).

The paper's gradient multiplies, for every action k, the matrix row m[k] with the advantage factored over reward
terms. Bellman's equation is linear in the reward, so the sum of the Q functions of the terms that k causes is the
Q function of the summed reward: one critic per *distinct row* of the matrix carries the same gradient with fewer
networks ("rows"). One critic per term ("terms") is the literal form and stays available.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.learners.methods import Method
from causalbench.core.learners.settings import CriticLayout
from causalbench.core.tasks.stage_task import StageTask
from causalbench.errors import UserError


@dataclass(frozen=True)
class StagePlan:
    """What the agent of one stage sets and learns.

    `actions` are indices into the task's actions, the rest is executed as 0; critic c learns the summed reward of
    the terms where `reward_groups[c]` is true; action k climbs critic c where `mask[k, c]` is true; the entropy
    bonus enters the critics where `entropy[c]` is true. With `joint_twin` the lesser twin is chosen by the sum
    over critics (their sum is the value), else for each critic alone (each is a value of its own).
    """

    actions: NDArray[np.int64]  # (n_own_actions,)
    reward_groups: NDArray[np.bool_]  # (n_critics, n_terms)
    mask: NDArray[np.bool_]  # (n_own_actions, n_critics)
    entropy: NDArray[np.bool_]  # (n_critics,)
    joint_twin: bool


def training_matrix(task: StageTask, graph: CausalGraph, stage: int) -> NDArray[np.bool_]:
    """(n_actions, n_terms) over all the task's terms: the graph's columns; ones for terms outside discovery."""
    full = np.zeros((len(task.actions), len(task.terms)), dtype=bool)
    found = graph.stages[stage - 1]
    for j, term in enumerate(task.terms):
        if stage in term.stages:
            full[:, j] = found.causes[:, found.terms.index(term.name)] if term.discoverable else True
    return full


def stage_plans(
    task: StageTask, method: Method, graph: CausalGraph | None, critics: CriticLayout, full_stages: Collection[int]
) -> list[StagePlan]:
    """The plans of all stages, in order; see `stage_plan`."""
    return [stage_plan(task, method, graph, i, critics, full_stages) for i in range(1, task.n_stages + 1)]


def stage_plan(
    task: StageTask,
    method: Method,
    graph: CausalGraph | None,
    stage: int,
    critics: CriticLayout = "rows",
    full_stages: Collection[int] = (),
) -> StagePlan:
    """Return the plan of `method` for `stage`, from 1; `graph` may be None for methods without a matrix.

    In `full_stages` a method with a matrix acts and learns as one without: all actions, scalar gradient. Raises
    `UserError` for such stages of a method that has no matrix, and for stages that the task does not have.
    """
    _check_full_stages(task, method, graph, full_stages)
    n_actions = len(task.actions)
    active = np.array([stage in term.stages for term in task.terms])
    if graph is None or stage in full_stages:
        one_for_all = np.ones((n_actions, 1), dtype=bool)
        return StagePlan(np.arange(n_actions), active[None], one_for_all, np.array([True]), joint_twin=False)
    matrix = training_matrix(task, graph, stage)
    actions = np.arange(n_actions)
    if method.action_space == "causal":
        own = graph.stages[stage - 1].policy_actions()
        actions = np.array([k for k, name in enumerate(task.actions) if name in own])
    matrix = matrix[actions]
    if method.gradient == "scalar":
        return StagePlan(actions, active[None], np.ones((len(actions), 1), dtype=bool), np.array([True]), False)
    if critics != "terms":
        rows, row_of = np.unique(matrix, axis=0, return_inverse=True)
        mask = row_of.reshape(-1, 1) == np.arange(len(rows))
        return StagePlan(actions, rows, mask, np.ones(len(rows), dtype=bool), joint_twin=False)
    groups = np.eye(len(task.terms), dtype=bool)[active]
    bonus = np.zeros(len(groups), dtype=bool)
    bonus[-1] = True  # the stage bonus is every action's: the entropy of all goes there, once
    return StagePlan(actions, groups, matrix[:, active], bonus, joint_twin=True)


def _check_full_stages(
    task: StageTask, method: Method, graph: CausalGraph | None, full_stages: Collection[int]
) -> None:
    if unknown := sorted({*full_stages} - {*range(1, task.n_stages + 1)}):
        raise UserError(f"setting `full_stages`: {unknown} are none of the {task.n_stages} stages of {task.name!r}")
    if full_stages and graph is None:
        raise UserError(f"setting `full_stages`: method {method.name!r} has all actions in every stage; leave it out")
