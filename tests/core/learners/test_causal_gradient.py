"""What a stage's agent is built from: actions, critics and masks of every method."""

import numpy as np
import pytest
import torch
from training import METHOD

from causalbench.core.discovery.graph import manual_graph
from causalbench.core.learners.causal_gradient import stage_plan, training_matrix
from causalbench.core.learners.methods import PAPER
from causalbench.core.tasks.pure_manipulation import TASK


@pytest.mark.parametrize("name", [method.name for method in PAPER])
@pytest.mark.parametrize("stage", [1, 2, 3, 4])
def test_plans_of_the_method_table(name, stage):
    method = METHOD[name]
    graph = None if method.matrix == "none" else manual_graph(TASK)
    plan = stage_plan(TASK, method, graph, stage)
    if method.action_space == "full":
        assert plan.actions.tolist() == list(range(7))
        assert plan.mask.shape == (7, 1)
        expected = [stage in term.stages for term in TASK.terms]
        assert plan.reward_groups.tolist() == [expected]
    else:
        causal = {1: "armx army armz grip", 2: "armrx armry armrz grip", 3: "armz grip", 4: "grip"}[stage]
        assert [TASK.actions[k] for k in plan.actions] == causal.split()
        # One critic a row: what action k climbs is the sum of exactly the terms in its row of the matrix.
        matrix = training_matrix(TASK, graph, stage)[plan.actions]
        np.testing.assert_array_equal(plan.mask.sum(1), 1)
        np.testing.assert_array_equal(plan.mask @ plan.reward_groups, matrix)
        assert len(plan.reward_groups) == len(np.unique(matrix, axis=0))


def test_rows_and_terms_are_the_same_gradient_where_values_are_linear():
    """With critics that are linear in the reward (one layer, same weights) both forms give the same actor gradient."""
    graph, method = manual_graph(TASK), METHOD["cmmSAC"]
    rows, terms = (stage_plan(TASK, method, graph, 1, critics) for critics in ("rows", "terms"))
    g = torch.Generator().manual_seed(0)
    slope = torch.randn(len(TASK.terms), len(rows.actions), generator=g)  # dQ_j / da_k of every term
    by_row = (rows.mask @ (rows.reward_groups @ slope.numpy()) * np.eye(len(rows.actions))).sum(1)
    by_term = (terms.mask * (terms.reward_groups @ slope.numpy()).T).sum(1)
    np.testing.assert_allclose(by_row, by_term, atol=1e-6)
