"""Discovery against planted truth, a null environment and closed forms."""

import dataclasses
import json

import numpy as np
import pytest
import torch
from scenes import discover
from toy import make_toy, toy_task
from truth import TRUTH

from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.graph import CausalGraph, manual_graph
from causalbench.core.discovery.methods.kl.divergence import divergence, gaussian_kl
from causalbench.core.discovery.methods.kl.settings import KLSettings
from causalbench.core.discovery.reward_model import network
from causalbench.core.discovery.samples.collect import collect
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.discovery.tables import evidence_table
from causalbench.core.kinematic import make
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.scene_worlds import SceneWorlds, judge
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.errors import InvalidGraphError

SMALL = DiscoverySettings(training_count=1500, options=KLSettings(max_epochs=12))


def _quiet(share, doing):
    pass


def _planted(previous, action, now):
    """r_0 is caused by armx alone, r_1 by army and armz together, r_2 by armz where the hand is far right."""
    x = previous.eef_position[..., 0]
    return np.stack([action[..., 0], action[..., 1] * action[..., 2], np.where(x > 0.5, action[..., 2], 0.0)], axis=-1)


@pytest.mark.parametrize("seed", [0, 1])
def test_recovers_a_planted_graph(seed):
    graph = discover(toy_task(_planted, 3), make_toy, SMALL, seed, _quiet)
    np.testing.assert_array_equal(
        graph.stages[0].matrix, [[True, False, False], [False, True, False], [False, True, True]]
    )
    assert graph.env_steps == 16 * (-(-1500 // 16)) * 5 + 16 * (-(-300 // 16))  # D_random, 4 D_do, D_inference


@pytest.mark.parametrize("seed", [0, 1])
def test_finds_nothing_where_no_action_matters(seed):
    noise = np.random.default_rng(seed)

    def null(previous, action, now):
        return np.stack([previous.eef_position[:, 0], noise.normal(size=len(action))], axis=1)

    graph = discover(toy_task(null, 2), make_toy, SMALL, seed, _quiet)
    assert not graph.stages[0].matrix.any()


def test_a_reward_that_never_varies_is_untestable_and_takes_the_declared_row():
    graph = discover(toy_task(lambda p, a, n: np.full((len(a), 1), -0.5), 1), make_toy, SMALL, 0, _quiet)
    assert graph.stages[0].testable.tolist() == [False]
    assert graph.stages[0].causal_actions() == ("armz",)


def test_the_graph_is_a_function_of_the_seed():
    task = toy_task(_planted, 3)
    small = dataclasses.replace(SMALL, training_count=200, options=KLSettings(max_epochs=2))
    first, again, other = (discover(task, make_toy, small, seed, _quiet).hash for seed in (3, 3, 4))
    assert first == again
    assert first != other


def test_the_gradients_of_a_batch_are_autograds():
    generator = torch.Generator().manual_seed(0)
    weights = network.initial_weights(3, 5, generator)
    x, target = torch.randn(3, 7, 5, generator=generator), torch.randn(3, 7, 1, generator=generator)
    free = [w.clone().requires_grad_() for w in weights]
    loss = network.negative_log_likelihood(network.forward(free, x), target, -4.0).sum()
    for w in weights:
        w.grad = torch.empty_like(w)
    network.set_gradients(weights, x, target, -4.0, network.working_space(3, 7))
    for w, expected in zip(weights, torch.autograd.grad(loss, free), strict=True):
        torch.testing.assert_close(w.grad, expected)


def test_gaussian_kl_equals_torch():
    generator = torch.Generator().manual_seed(0)
    mean_p, mean_q = torch.randn(2, 50, generator=generator)
    sigma_p, sigma_q = torch.rand(2, 50, generator=generator) + 0.1
    p, q = torch.distributions.Normal(mean_p, sigma_p), torch.distributions.Normal(mean_q, sigma_q)
    expected = torch.distributions.kl_divergence(p, q)
    torch.testing.assert_close(gaussian_kl(mean_p, sigma_p, mean_q, sigma_q), expected)


def test_divergence_directions_and_floor():
    one, log_sigma = torch.zeros(1, 4), torch.full((1, 4), -20.0)
    two, wide = torch.full((1, 4), 0.2), torch.zeros(1, 4)
    both_floored = divergence(one, log_sigma, two, log_sigma, 0.2)
    assert both_floored.forward.item() == pytest.approx(0.5)  # (0.2 / 0.2)^2 / 2
    uneven = divergence(one, log_sigma, two, wide, 0.2)
    assert uneven.forward.item() == pytest.approx(np.log(1 / 0.2) + (0.04 + 0.04) / 2 - 0.5)
    assert uneven.reverse.item() == pytest.approx(np.log(0.2) + (1 + 0.04) / (2 * 0.04) - 0.5)
    assert uneven.symmetric.item() == pytest.approx((uneven.forward + uneven.reverse).item() / 2)


def _collected(stage, do, count=64, action_repeat=1, by_step=False):
    steps = []
    rng, batch = np.random.default_rng(5), make().batch(8)
    worlds = SceneWorlds(TASK, batch)
    samples = collect(worlds, stage, count, do, rng, 10, 1, steps.append, "", action_repeat, by_step)
    return samples, sum(steps)


@pytest.mark.parametrize("stage", [1, 2, 3, 4])
@pytest.mark.parametrize("do", [None, 2, 7])
@pytest.mark.parametrize("by_step", [False, True])
def test_collect_intervenes_on_one_action_only(stage, do, by_step):
    samples, steps = _collected(stage, do, by_step=by_step)
    assert steps == 64
    held = np.zeros(8)
    if do is not None:
        held[do] = 0.5 if by_step else 1.0
    np.testing.assert_allclose((samples.actions == 0).mean(0), held, atol=0.2 * by_step)
    assert (np.abs(samples.actions) <= 1).all()
    assert samples.rewards.shape == (64, len(TASK.stage_terms(stage, discoverable_only=True)))
    np.testing.assert_array_equal(samples.without(3).actions[:, 3], 0)
    np.testing.assert_array_equal(np.delete(samples.without(3).actions, 3, 1), np.delete(samples.actions, 3, 1))


def test_an_action_that_is_held_goes_as_many_times_as_far():
    """r_eefy in stage 1 is 10 times the way along world y towards the box, 2 cm a control step at most."""
    way = {}
    for repeat in (1, 3):
        samples, steps = _collected(1, None, 400, repeat)
        assert steps == samples.env_steps == 400 * repeat
        way[repeat] = np.abs(samples.rewards[:, 1] / samples.actions[:, 0]).max() / 10.0
    assert way[1] == pytest.approx(0.02, rel=1e-4)
    assert way[3] == pytest.approx(0.06, rel=1e-4)


def test_collect_keeps_the_step_that_leaves_the_stage():
    """More than half of the random steps leave stage 3: their rewards, with steps beyond the window, must be there."""
    samples, _ = _collected(3, None, 400)
    heights = samples.states[:, 5] - samples.states[:, 2]
    drop = samples.rewards[:, 0] / 10.0  # metres nearer to the grasp height
    after = np.abs(heights - 0.012) - drop
    assert ((after < 0.012) | (after > 0.15)).any()


def test_the_evidence_has_one_row_per_edge_in_the_order_of_the_task():
    small = dataclasses.replace(SMALL, training_count=60, options=KLSettings(max_epochs=1))
    graph = discover(TASK, make, small, 0, _quiet)
    table = evidence_table(graph)
    assert list(table.columns) == [
        *("stage", "term", "action", "outcome", "selected", "in_policy", "kl", "kl_forward", "kl_reverse"),
        *("kl_symmetric", "kl_normalised", "q_value", "cv"),
    ]
    edges = [(g.stage, term, action) for g in graph.stages for term in g.terms for action in g.actions]
    assert list(zip(table.stage, table.term, table.action, strict=True)) == edges
    third = table[(table.stage == 3) & (table.term == "r_gripper")]
    np.testing.assert_array_equal(third.kl, graph.stages[2].evidence["kl"][:, 1])
    np.testing.assert_array_equal(third.cv, graph.stages[2].evidence["cv"][[1] * 7])


def test_graph_round_trip_and_refusals(tmp_path):
    graph = manual_graph(TASK)
    again = CausalGraph.from_json(graph.to_json())
    assert again.hash == graph.hash
    again.check(TASK)
    edited = json.loads(graph.to_json())
    edited["stages"][0]["matrix"][0][0] = True
    with pytest.raises(InvalidGraphError, match="was it edited"):
        CausalGraph.from_json(json.dumps(edited), "graph.json")
    with pytest.raises(InvalidGraphError, match=r"graph\.json: not a causal graph"):
        CausalGraph.from_json("{}", "graph.json")
    empty = dataclasses.replace(graph.stages[3], matrix=np.zeros_like(graph.stages[3].matrix))
    with pytest.raises(InvalidGraphError, match="stage 4: no action causes"):
        dataclasses.replace(graph, stages=(*graph.stages[:3], empty)).check(TASK)
    renamed = dataclasses.replace(graph.stages[0], actions=("a", "b", "c", "d", "e", "f", "g"))
    with pytest.raises(InvalidGraphError, match="stage 1: actions or terms differ"):
        dataclasses.replace(graph, stages=(renamed, *graph.stages[1:])).check(TASK)


def test_paper_presets_have_the_papers_numbers():
    paper, large = (DISCOVERERS["kl"].configure(name) for name in ("paper", "paper_large"))
    own = paper.options
    assert (paper.training_count, paper.n_placebos) == (5000, 0)
    assert (own.batch_size, own.learning_rate, own.max_epochs, own.patience) == (32, 5e-4, 100, 0)
    assert (own.epsilon_cv, own.epsilon_normalize, own.epsilon_direct) == (1.0, 0.1, 0.01)
    longer = dataclasses.replace(own, max_epochs=500)
    assert large == dataclasses.replace(paper, training_count=10_000, options=longer)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_finds_the_closed_form_truth_on_kinematic(seed):
    graph = discover(TASK, make, DiscoverySettings(), seed, _quiet)
    found = {
        g.stage: {
            t: {a for a, chosen in zip(g.actions, g.matrix[:, j], strict=True) if chosen} for j, t in enumerate(g.terms)
        }
        for g in graph.stages
    }
    assert found == TRUTH


@pytest.mark.parametrize("stage", [1, 2, 3, 4])
def test_closed_form_truth_by_exact_counterfactuals(stage):
    """Same state and other actions, a_k random against 0: the effect is exactly zero unless the truth has the edge."""
    rng = np.random.default_rng(stage)
    env = StageTaskEnv(SceneWorlds(TASK, make()))
    effects = np.zeros((7, 9))
    for _ in range(60):
        env.reset(seed=int(rng.integers(2**31)), options={"stage": stage})
        if stage == 1:  # walk on to the reach limit, where armx lowers the hand
            for _ in range(8):
                env.worlds.scene.step(np.array([0.3, 0, 1.0, 0, 0, 0, 0]))
        start, before = env.worlds.scene.snapshot(), env.worlds.scene.facts()
        if TASK.stage(before) != stage:
            continue
        action = rng.uniform(-1, 1, 7)
        outcomes = []
        for k in range(-1, 7):
            tried = action.copy()
            if k >= 0:
                tried[k] = 0.0
            env.worlds.scene.restore(start)
            env.worlds.scene.step(tried)
            outcomes.append(judge(TASK, np.int64(stage), before, tried, env.worlds.scene.facts()).rewards)
        effects = np.maximum(effects, np.abs(np.array(outcomes[1:]) - outcomes[0]))
    for term, causes in TRUTH[stage].items():
        column = effects[:, TASK.term_names.index(term)]
        assert {a for a, e in zip(TASK.actions, column, strict=True) if e > 1e-9} == causes
