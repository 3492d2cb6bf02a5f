"""`anytime` and the e-values that it rests on: levels kept at every look, planted effects found, three outcomes."""

from types import SimpleNamespace

import numpy as np
import pytest

from causalbench import worlds
from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.methods.anytime import betting
from causalbench.core.discovery.methods.anytime.method import Verdicts
from causalbench.core.discovery.methods.anytime.pairs import Compared


def _graph(world, seed=0, **own):
    return worlds.discover(world, DISCOVERERS["anytime"].configure("quick", {}, own), seed)


def _ever(evidence, values, level):
    """Share of the columns of `values` (n, columns) whose e-value reaches 1 / level at any look."""
    looks = [evidence(values[:n]) >= np.log(1 / level) for n in range(2, len(values), 3)]
    return np.any(looks, axis=0).mean()


@pytest.mark.parametrize(
    ("evidence", "draw"),
    [
        (lambda x: betting.above(x, 1.0), lambda rng, size: rng.exponential(1.0, size)),
        (lambda x: betting.above(x, 1.0), lambda rng, size: 20.0 * (rng.random(size) < 0.05)),
        (lambda x: betting.below(x, 1.0, 20.0), lambda rng, size: 20.0 * (rng.random(size) < 0.05)),
        (betting.positive, lambda rng, size: rng.standard_cauchy(size)),
        (lambda x: betting.positive(x, both_signs=True), lambda rng, size: rng.normal(size=size)),
    ],
)
def test_e_values_keep_their_level_at_every_look(evidence, draw):
    """On the border of the null hypothesis, heavy tails and rare events included: Ville's inequality, 1,000 times."""
    values = draw(np.random.default_rng(0), (200, 1_000))
    assert _ever(evidence, values, 0.05) <= 0.07


def test_e_values_grow_where_the_hypothesis_is_wrong():
    rng = np.random.default_rng(0)
    assert (betting.above(rng.exponential(4.0, (60, 100)), 1.0) > 7).mean() > 0.9
    assert (betting.positive(rng.normal(0.8, 1.0, (80, 100))) > 7).mean() > 0.9
    assert betting.below(np.zeros((200, 1)), 0.05, 1.0)[0] > 7


@pytest.mark.parametrize(
    "kind",
    ["absolute", "cosine", "delayed", "dominant", "even", "heavy_tails", "hidden_sign", "interaction_of_3", "units",
     "variance_only", "confounded", "left_at_once"],
)  # fmt: skip
def test_strong_edges_are_found_and_no_other(kind):
    world = worlds.planted(kind, 5)
    for stage in _graph(world).stages:
        effect = worlds.effects(world, stage.stage)
        assert stage.matrix[effect > 0.06].all()
        assert not stage.matrix[effect == 0].any()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["null", "null_heavy", "null_restore_noise_0.1", "null_restore_noise_0.9"])
def test_where_nothing_matters_nothing_is_found(kind, seed):
    (stage,) = _graph(worlds.planted(kind, seed), seed, max_actions_inexact=500).stages
    assert not stage.matrix.any()


def test_where_restoring_is_noisy_strong_edges_are_found_or_left_undecided():
    world = worlds.planted("restore_noise_0.1", 0)
    (stage,) = _graph(world, max_actions_inexact=1_500).stages
    effect = worlds.effects(world, 1)
    assert stage.matrix[effect > 0.3].all()
    assert not stage.matrix[effect == 0].any()
    assert (stage.matrix | stage.left_open)[effect > 0.1].all()


@pytest.mark.parametrize(("squares", "outcome"), [((1.0, 0.0), "undecided"), ((0.0, 0.0), "absent")])
def test_an_effect_on_a_term_that_has_not_varied_waits_until_it_does(squares, outcome):
    """Random actions never earned the reward; with one of two actions left at 0 they would have: a share of nothing."""
    compared = [Compared(np.array(squares)[:, None], np.zeros((2, 1))) for _ in range(300)]
    pairs = SimpleNamespace(
        shape=(2, 1), exact=True, taken=[np.zeros(1)] * 300, variance=np.zeros(1),
        compared=compared, measured=[np.ones(2, dtype=bool)] * 300,
    )  # fmt: skip
    verdicts = Verdicts(pairs, level=0.01, miss=0.01, rare=0.05)
    verdicts.look(last=True)
    verdicts.close()
    assert not verdicts.present.any()
    assert verdicts.open[0, 0] == (outcome == "undecided")
    assert (verdicts.effect == 0.0).all()
    pairs.taken[:150], pairs.variance = [np.ones(1)] * 150, np.full(1, 0.25)
    verdicts.look()
    assert verdicts.present[0, 0] == (outcome == "undecided")


def test_an_undecided_edge_is_in_the_file_and_a_learner_takes_it_for_what_the_setting_says():
    world = worlds.planted("restore_noise_0.3", 0)
    both = {}
    for told in ("present", "absent"):
        settings = DISCOVERERS["anytime"].configure("quick", {"undecided": told}, {"max_actions_inexact": 200})
        (stage,) = CausalGraph.from_json(worlds.discover(world, settings).to_json()).stages
        assert stage.left_open.any()
        assert not (stage.matrix & stage.left_open).any()
        both[told] = stage.causes
        np.testing.assert_array_equal(stage.causes, stage.matrix | (stage.left_open & (told == "present")))
    assert both["present"].sum() > both["absent"].sum()


def test_without_snapshots_samples_prove_causes_and_no_absence():
    world = worlds.planted("no_snapshots", 0)
    (stage,) = _graph(world).stages
    effect = worlds.effects(world, 1)
    assert stage.matrix[effect > 0.15].all()
    np.testing.assert_array_equal(stage.left_open, ~stage.matrix)
    assert not stage.matrix[effect == 0].any()
