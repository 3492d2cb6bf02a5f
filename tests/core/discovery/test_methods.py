"""Every registered discoverer against planted truth and an environment where nothing matters."""

import dataclasses
import math
from functools import partial

import numpy as np
import pytest
import torch
from scenes import counting, discover
from scipy import stats
from toy import make_noisy_toy, make_toy, toy_task
from truth import TRUTH

from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.methods.ace import adaptive_lasso
from causalbench.core.discovery.methods.cai import CAISettings, influence_of
from causalbench.core.discovery.methods.ibd import two_samples
from causalbench.core.discovery.methods.independence import independent_columns
from causalbench.core.discovery.methods.paired import PairedSettings
from causalbench.core.discovery.methods.permutation import sign_flip_p_values
from causalbench.core.discovery.pipeline import discover_from_samples
from causalbench.core.discovery.samples.transitions import Samples
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.discovery.truth.counterfactual import Walk
from causalbench.core.kinematic import make
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks.mobile_manipulation import TASK as MOBILE
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.errors import UnknownNameError
from causalbench.store.samples import SampleFolder

SMALL = DiscoverySettings(training_count=1500)
OWN = {
    "kl": {"max_epochs": 12},
    "cmi": {"max_epochs": 40},  # its threshold is in nats: an unfinished fit is off by more
    "cai": {"max_epochs": 40},
    "kci": {"samples": 300},
}
COUNT = {"ibd": 4000}  # compares distributions, in which an effect stands beside all others
PAIRED = ("anytime", "paired", "sufficient", "permutation")


def _quiet(share, doing):
    pass


def _graph(name, task, make_scene=make_toy, seed=0):
    options = DISCOVERERS[name].settings(**OWN.get(name, {})) if name in DISCOVERERS else None
    count = COUNT.get(name, SMALL.training_count)
    settings = dataclasses.replace(SMALL, discoverer=name, options=options, training_count=count)
    return discover(task, make_scene, settings, seed, _quiet)


def _planted(previous, action, now):
    """r_0 is caused by armx alone, r_1 by army and armz together."""
    return np.stack([action[..., 0], action[..., 1] + 0.7 * action[..., 2]], axis=-1)


def _of_the_state(previous, action, now):
    """Nothing matters: both terms are functions of where the hand was."""
    hand = previous.eef_position
    return np.stack([hand[..., 0], hand[..., 1] - hand[..., 2]], axis=-1)


@pytest.mark.parametrize("name", DISCOVERERS)
def test_recovers_a_planted_graph(name):
    stage = _graph(name, toy_task(_planted, 2)).stages[0]
    np.testing.assert_array_equal(stage.matrix, [[True, False], [False, True], [False, True]])
    assert stage.testable.all()


@pytest.mark.parametrize(
    ("name", "sets"),
    [
        (
            "kl",
            {"random": 160, "inference": 32} | dict.fromkeys(("do-armx", "do-army", "do-armz", "placebo"), 160),
        ),
        ("cmi", {"random": 160, "inference": 32}),
        ("cai", {"random": 160, "inference": 32}),
        ("ibd", {"random": 160} | dict.fromkeys(("do-armx", "do-army", "do-armz", "placebo"), 160)),
        ("ace", {"random": 160}),
        ("fisher_z", {"random": 160}),
        ("hrt", {"random": 160}),
        ("kci", {"random": 160}),
    ],
)
def test_only_what_a_discoverer_reads_costs_steps(name, sets, tmp_path):
    own = {"max_epochs": 2} if name in ("kl", "cmi", "cai") else {}
    settings = DISCOVERERS[name].configure("quick", {"training_count": 160}, own)
    task, store = toy_task(_planted, 2), SampleFolder(tmp_path)
    graph = discover(task, make_toy, settings, 0, _quiet, store=store)
    assert graph.env_steps == sum(sets.values())
    assert {path.stem for path in tmp_path.glob("*.npz")} == {f"stage1-{name}" for name in sets}
    again = discover_from_samples(task, store, store.origin()[0], settings, 0, _quiet)
    assert again.to_json() == graph.to_json()


@pytest.mark.parametrize("name", DISCOVERERS)
def test_finds_nothing_where_no_action_matters(name):
    assert not _graph(name, toy_task(_of_the_state, 2)).stages[0].matrix.any()


def test_rounding_is_no_effect():
    task = toy_task(lambda p, a, n: (p.eef_position[..., 0] + 1e-14 * a[..., 1])[..., None], 1)
    assert not _graph("permutation", task).stages[0].matrix.any()


@pytest.mark.parametrize("name", PAIRED)
def test_pairs_are_taken_where_the_environment_scans(name):
    """Mobile manipulation observes a LiDAR; its first stage is decided by driving alone (closed form of the base)."""
    own = {"states": 40} if name == "permutation" else {"max_actions": 400}
    settings = DISCOVERERS[name].configure("quick", {}, own)
    graph = discover(MOBILE, partial(make, mobile=True), settings, 0, _quiet)
    assert graph.stages[0].causal_actions()[0] == "forward"
    assert not graph.stages[0].matrix[2:, 0].any()  # the arm does not move the base


@pytest.mark.parametrize(("action_repeat", "found"), [(1, ("forward",)), (5, ("forward", "turn"))])
def test_a_turn_brings_a_base_nearer_only_if_it_is_held_while_it_drives(action_repeat, found):
    settings = DISCOVERERS["paired"].configure("quick", {"action_repeat": action_repeat}, {"max_actions": 900})
    make_counting, counts = counting(partial(make, mobile=True))

    graph = discover(MOBILE, make_counting, settings, 0, _quiet)
    assert graph.stages[0].causal_actions() == found
    assert graph.env_steps == sum(counts) <= MOBILE.n_stages * 900 * action_repeat


@pytest.mark.parametrize("name", PAIRED)
def test_where_restoring_is_inexact_noise_is_no_cause(name):
    def of_the_hand(previous, action, now):
        moved = now.eef_position - previous.eef_position
        return np.stack([moved[..., 0], moved[..., 1] + previous.eef_position[..., 2]], axis=-1)

    (stage,) = _graph(name, toy_task(of_the_hand, 2), make_noisy_toy).stages
    causes = np.zeros((3, 2), dtype=bool)
    causes[[0, 1], [0, 1]] = True
    assert not stage.matrix[~causes].any()
    assert stage.matrix[0, 0]
    assert stage.matrix[1, 1] or name == "anytime"  # a hundredth of the variance: weak, so that its bound may decide


def test_two_samples_of_single_steps_are_scipys_kolmogorov_smirnov():
    rng = np.random.default_rng(3)
    for shift in (0.0, 0.15, 0.5):
        values = np.round(rng.normal(size=300), 2)  # with ties
        second = np.arange(300) >= 140
        values[second] += shift
        distance, p_value = two_samples(values, second, np.arange(300, dtype=np.int32), 2000, rng)
        scipys = stats.ks_2samp(values[~second], values[second], method="asymp")
        assert distance == pytest.approx(scipys.statistic, abs=1e-12)
        assert p_value == pytest.approx(scipys.pvalue, abs=0.05)


def test_two_samples_of_sequences_are_judged_by_sequences():
    """Steps of a sequence are one number: 20 sequences on either side, not 1,000 steps, are what is compared."""
    rng = np.random.default_rng(4)
    cluster = np.repeat(np.arange(40, dtype=np.int32), 50)
    alike = np.repeat(rng.normal(size=40), 50)
    assert stats.ks_2samp(alike[:1000], alike[1000:]).pvalue < 1e-6
    assert two_samples(alike, cluster >= 20, cluster, 2000, rng)[1] > 0.05
    assert two_samples(alike + 3.0 * (cluster >= 20), cluster >= 20, cluster, 2000, rng)[1] < 0.001


def test_influence_is_the_information_of_a_normal_channel():
    """r = s a + noise of deviation 1/2, a uniform on [-1, 1]: the mixture's variance is s^2 / 3 + 1/4."""

    class Channel:
        def predict(self, samples, k):
            mean = torch.from_numpy(samples.states[:, 0] * samples.actions[:, 0])[None]
            return mean, torch.full_like(mean, math.log(0.5))

    states = np.array([[0.0], [1.0], [4.0]], dtype=np.float32)
    samples = Samples(states, np.zeros((3, 1), np.float32), states, np.zeros(3, np.int32), 3)
    settings = CAISettings(redraws=4000)
    (found,) = influence_of(0, Channel(), samples, settings, np.random.default_rng(0))
    np.testing.assert_allclose(found, 0.5 * np.log((states[:, 0] ** 2 / 3 + 0.25) / 0.25), atol=0.02)


def test_pruned_weights_are_those_of_a_linear_model():
    rng = np.random.default_rng(5)
    inputs = rng.normal(size=(2000, 5))
    weights = np.array([1.0, 0.0, -0.3, 0.0, 0.1])
    found = adaptive_lasso(inputs, inputs @ weights + 0.1 * rng.normal(size=2000))
    np.testing.assert_array_equal(found != 0, weights != 0)
    np.testing.assert_allclose(found, weights, atol=0.01)


def test_an_interaction_is_found_from_pairs_and_missed_by_linear_correlation():
    task = toy_task(lambda p, a, n: (a[..., 1] * a[..., 2])[..., None], 1)
    assert _graph("paired", task).stages[0].matrix[:, 0].tolist() == [False, True, True]
    assert _graph("fisher_z", task).stages[0].matrix[:, 0].tolist() == [False, False, False]


@pytest.mark.parametrize("seed", [0, 1])
def test_paired_finds_the_closed_form_truth_within_its_budget(seed):
    settings = DiscoverySettings(discoverer="paired")
    make_counting, counts = counting(make)

    graph = discover(TASK, make_counting, settings, seed, _quiet)
    found = {
        g.stage: {
            t: {a for a, chosen in zip(g.actions, g.matrix[:, j], strict=True) if chosen} for j, t in enumerate(g.terms)
        }
        for g in graph.stages
    }
    assert found == TRUTH
    assert graph.env_steps == sum(counts) <= 4 * PairedSettings().max_actions


def test_paired_says_what_it_could_not_decide():
    rare = toy_task(lambda p, a, n: np.where(p.eef_position[..., 0] > 0.99, a[..., 0], 0.0)[..., None], 1)
    settings = DiscoverySettings(discoverer="paired", options=PairedSettings(max_actions=60))
    (stage,) = discover(rare, make_toy, settings, 0, _quiet).stages
    assert any("was not decided within the budget" in n or "never varied" in n for n in stage.notes)


def test_a_walk_goes_on_from_the_step_that_was_taken_whatever_else_was_tried():
    def walk(tries):
        scene = make_toy()
        steps = Walk(SceneWorlds(toy_task(_planted, 2), scene), 1, np.random.default_rng(7), 5)
        hands = []
        for _ in range(12):
            action = steps.visit()
            hands.append(scene.facts().eef_position)
            steps.take(action)
            for k in range(tries):
                steps.reward_of(np.full(3, 0.1 * k))
        return np.array(hands), steps.sequence

    plain, sequence = walk(0)
    tried, _ = walk(3)
    np.testing.assert_array_equal(plain, tried)
    assert sequence == 2  # sequences of 5 steps: 5, 5 and the start of the third


def test_sign_flip_p_values_are_uniform_under_the_null_and_exact_for_few_rows():
    rng = np.random.default_rng(0)
    p = sign_flip_p_values(rng.normal(size=(30, 400)), rng)
    assert abs((p < 0.1).mean() - 0.1) < 4 * math.sqrt(0.09 / 400)
    one_sided = sign_flip_p_values(np.ones((5, 1)), rng)
    assert one_sided[0] == pytest.approx(2**-5, abs=0.01)
    assert sign_flip_p_values(np.zeros((5, 1)), rng)[0] == 1.0


def test_columns_that_repeat_others_are_left_out():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 300))
    kept = independent_columns(np.column_stack([a, np.ones(300), 2 * a + 1, b, a - b]))
    np.testing.assert_allclose(np.abs(np.corrcoef(kept.T, np.array([a, b]))[:2, 2:]), np.eye(2), atol=0.15)
    assert kept.shape == (300, 2)


def test_a_discoverer_that_does_not_exist_is_refused():
    with pytest.raises(UnknownNameError, match=r"unknown discoverer 'pared'. Did you mean 'paired'\?"):
        _graph("pared", toy_task(_planted, 2))
