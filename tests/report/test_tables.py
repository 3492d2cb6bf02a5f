"""Rows of a run's tables that no run of the other tests has."""

import dataclasses

import numpy as np

from causalbench.core.discovery.edges import edge_rows
from causalbench.core.discovery.graph import manual_graph
from causalbench.core.tasks.pure_manipulation import TASK


def test_an_edge_says_whether_the_policy_sets_its_action():
    human = manual_graph(TASK)
    last = human.stages[3]
    causes = dataclasses.replace(last, matrix=np.ones_like(last.matrix))
    for graph, expected in ((causes, 7 * [1]), (dataclasses.replace(causes, sufficient=("grip",)), 6 * [0] + [1])):
        rows = list(edge_rows(dataclasses.replace(human, stages=(graph,))))
        assert [row["in_policy"] for row in rows] == expected
        assert [row["selected"] for row in rows] == 7 * [1]
