"""Which of the causes a stage needs, against toys whose answer is known, and what a policy makes of it."""

import dataclasses
from fractions import Fraction
from math import comb

import numpy as np
import pytest
from scenes import counting, discover
from toy import make_toy, toy_task

from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.methods.paired import PairedSettings
from causalbench.core.discovery.methods.sufficient import LEVEL, _oftener
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.learners.causal_gradient import stage_plan
from causalbench.core.learners.methods import METHODS
from causalbench.errors import InvalidGraphError

SETTINGS = DiscoverySettings(discoverer="sufficient", options=PairedSettings(max_actions=400))
CM = next(method for method in METHODS if method.name == "cmSAC")


def _task(success):
    """The hand starts at 0; armx and army cause the reward, armz does not."""
    task = toy_task(lambda p, a, n: (n.eef_position[..., 0] - 2 * np.abs(n.eef_position[..., 1]))[..., None], 1)

    def at_rest(*args):
        return dataclasses.replace(task.draw_layout(*args), eef_position=np.zeros(3))

    return dataclasses.replace(task, draw_layout=at_rest, success=lambda stage, now: success(*now.eef_position.T[:2]))


FAR, STRAIGHT = 0.05, 0.005
TASKS = {
    "army spoils": _task(lambda x, y: (x > FAR) & (np.abs(y) < STRAIGHT)),
    "both are needed": _task(lambda x, y: (x > FAR) & (y > FAR)),
    "out of reach": _task(lambda x, y: x > 100 * FAR),
}


def _graph(name, seed=0):
    return discover(TASKS[name], make_toy, SETTINGS, seed, lambda share, doing: None)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("name", "enough", "note"),
    [
        ("army spoils", ("armx",), "enough for a policy"),
        ("both are needed", None, "all stay"),
        ("out of reach", None, "too few to compare"),
    ],
)
def test_a_cause_that_only_spoils_a_stage_is_left_out(name, enough, note, seed):
    (stage,) = _graph(name, seed).stages
    assert stage.causal_actions() == ("armx", "army")
    assert stage.sufficient == enough
    assert stage.policy_actions() == (enough or ("armx", "army"))
    assert note in stage.notes[-1]


def test_edges_are_those_of_paired_and_every_step_counts():
    make_counting, counts = counting(make_toy)

    task = TASKS["army spoils"]
    graph = discover(task, make_counting, SETTINGS, 0, lambda share, doing: None)
    paired = discover(task, make_toy, dataclasses.replace(SETTINGS, discoverer="paired"), 0, lambda share, doing: None)
    np.testing.assert_array_equal(graph.stages[0].evidence["effect"], paired.stages[0].evidence["effect"])
    assert graph.env_steps == sum(counts) > paired.env_steps


@pytest.mark.parametrize("counts", [(9, 20, 20, 300), (1, 20, 20, 300), (0, 5, 0, 7), (4, 4, 6, 6), (7, 60, 0, 60)])
def test_oftener_is_fishers_exact_test(counts):
    hits, n, others_hits, m = counts
    drawn = hits + others_hits  # of n + m, without order: the chance of at least as many among the n
    at_least = sum(comb(n, k) * comb(m, drawn - k) for k in range(hits, min(n, drawn) + 1))
    p = Fraction(at_least, comb(n + m, drawn))
    assert _oftener(np.arange(n) < hits, np.arange(m) < others_hits) == (p < LEVEL)


def test_a_policy_sets_the_sufficient_actions_alone_and_the_file_keeps_them():
    task, graph = TASKS["army spoils"], _graph("army spoils")
    again = CausalGraph.from_json(graph.to_json())
    assert again.hash == graph.hash
    assert again.stages[0].sufficient == ("armx",)
    assert stage_plan(task, CM, again, 1).actions.tolist() == [0]
    full = next(method for method in METHODS if method.name == "cmSAC-full")
    assert stage_plan(task, full, again, 1).actions.tolist() == [0, 1, 2]


@pytest.mark.parametrize("sufficient", [(), ("armz",), ("armx", "armz")])
def test_sufficient_actions_that_are_no_causes_are_refused(sufficient):
    graph = _graph("army spoils")
    stages = (dataclasses.replace(graph.stages[0], sufficient=sufficient),)
    with pytest.raises(InvalidGraphError, match="are not some of its causal actions"):
        dataclasses.replace(graph, stages=stages).check(TASKS["army spoils"])
