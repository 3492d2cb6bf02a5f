"""The false-discovery control against independent implementations and planted nulls."""

import dataclasses

import numpy as np
import pytest
from scenes import discover
from toy import make_toy, toy_task

from causalbench.core.discovery.methods.kl.placebos import calibrate, p_values, placebo_copy, q_values
from causalbench.core.discovery.methods.kl.settings import KLSettings
from causalbench.core.discovery.samples.transitions import Samples
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.errors import UserError


def _stages(seed):
    rng = np.random.default_rng(seed)
    shapes = [(int(rng.integers(1, 8)), int(rng.integers(1, 5))) for _ in range(int(rng.integers(1, 5)))]
    edges = [rng.lognormal(0, 2, shape) for shape in shapes]
    return edges, [rng.lognormal(0, 1, (int(rng.integers(5, 60)), terms)) for _, terms in shapes]


@pytest.mark.parametrize("seed", range(20))
def test_q_values_are_those_of_brute_force(seed):
    edges, nulls = _stages(seed)
    pool = [value / np.median(null[:, j]) for null in nulls for j in range(null.shape[1]) for value in null[:, j]]
    p = [
        (1 + sum(other >= value / np.median(null[:, j]) for other in pool)) / (1 + len(pool))
        for edge, null in zip(edges, nulls, strict=True)
        for row in edge
        for j, value in enumerate(row)
    ]
    tested = np.concatenate([values.ravel() for values in p_values(edges, nulls)])
    within = np.array(p) > 1 / (1 + len(pool))
    np.testing.assert_allclose(tested[within], np.array(p)[within])
    assert (
        tested[~within] <= 1 / (1 + len(pool))
    ).all()  # beyond every null: the fitted tail, never more than counting
    p = tested.tolist()
    found = np.concatenate([q.ravel() for q in q_values(edges, nulls)])
    # Benjamini and Hochberg: q is the least p m / rank of the p-values that are as large; ties share the last rank.
    rates = {value: value * len(p) / sum(other <= value for other in p) for value in p}
    q = [min(1.0, *(rates[other] for other in p if other >= value)) for value in p]
    np.testing.assert_allclose(found, q)


@pytest.mark.parametrize("seed", range(5))
def test_q_values_do_not_depend_on_the_scale_of_a_term(seed):
    edges, nulls = _stages(seed)
    scales = [np.random.default_rng(9).lognormal(0, 3, null.shape[1]) for null in nulls]
    scaled = q_values(
        [e * s for e, s in zip(edges, scales, strict=True)], [n * s for n, s in zip(nulls, scales, strict=True)]
    )
    for one, other in zip(q_values(edges, nulls), scaled, strict=True):
        np.testing.assert_allclose(one, other)


def test_the_false_discovery_rate_is_kept_where_nulls_are_exchangeable():
    """63 edges of which 10 are far above the nulls, 400 times: at most 5% of the selected are wrong, on average."""
    rng = np.random.default_rng(0)
    shares = []
    for _ in range(400):
        edges, nulls = [rng.lognormal(0, 1, (7, 9))], [rng.lognormal(0, 1, (40, 9))]
        edges[0].flat[:10] = 1e6
        selected = q_values(edges, nulls)[0].ravel() <= 0.05
        assert selected[:10].all()
        shares.append(selected[10:].sum() / selected.sum())
    assert np.mean(shares) <= 0.06  # the median that a term's nulls are divided by is estimated from them


@pytest.mark.parametrize("n_terms", [1, 4])
@pytest.mark.parametrize("n_actions", [4, 7])
def test_one_edge_far_beyond_the_nulls_is_selected_and_null_worlds_stay_empty(n_actions, n_terms):
    """Forty nulls a term, as by default; counting alone lets no fewer than about half of the actions be selected."""
    rng, found = np.random.default_rng(n_actions), []
    for _ in range(200):
        edges, nulls = [rng.lognormal(0, 1, (n_actions, n_terms))], [rng.lognormal(0, 1, (40, n_terms))]
        found.append((q_values(edges, nulls)[0] <= 0.05).any())
        edges[0][0, 0] = 1e4
        assert q_values(edges, nulls)[0][0, 0] <= 0.05
    assert np.mean(found) <= 0.1  # 0.05 and two deviations of 200 worlds


@pytest.mark.parametrize("zeros", [0.25, 0.5])
def test_a_placebo_copy_changes_placebos_alone(zeros):
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (1000, 5)).astype(np.float32)
    extra = Samples(actions[:, :2], actions, actions[:, :1], np.zeros(1000, np.int32), 1000)
    one, two = (placebo_copy(extra, 3, zeros, rng) for _ in range(2))
    for copy in (one, two):
        np.testing.assert_array_equal(copy.actions[:, :3], extra.actions[:, :3])
        assert np.abs((copy.actions[:, 3:] == 0).mean(0) - zeros).max() < 0.06
    assert (one.actions[:, 3:] != two.actions[:, 3:]).mean() > 0.7


SMALL = DiscoverySettings(training_count=1500, options=KLSettings(max_epochs=12))


def _planted(previous, action, now):
    """As in test_discovery: r_0 by armx, r_1 by army and armz, r_2 by armz where the hand is far right."""
    x = previous.eef_position[:, 0]
    return np.stack([action[:, 0], action[:, 1] * action[:, 2], np.where(x > 0.5, action[:, 2], 0.0)], axis=1)


def test_both_selections_come_from_one_fit():
    (paper,) = discover(toy_task(_planted, 3), make_toy, SMALL, 0, lambda share, doing: None).stages
    (fdr,) = calibrate([paper], dataclasses.replace(SMALL, options=KLSettings(select="fdr")))
    truth = np.array([[True, False, False], [False, True, False], [False, True, True]])
    assert paper.evidence["null_kl"].shape == (40, 3)
    np.testing.assert_array_equal(paper.matrix, truth)
    np.testing.assert_array_equal(fdr.evidence["q_value"], paper.evidence["q_value"])
    np.testing.assert_array_equal(fdr.matrix, paper.evidence["q_value"] <= 0.05)
    assert fdr.matrix[truth].all()


def test_no_placebos_no_calibrated_cut():
    settings = DiscoverySettings(n_placebos=0, options=KLSettings(select="fdr"))
    with pytest.raises(UserError, match="n_placebos"):
        discover(toy_task(_planted, 3), make_toy, settings, 0, lambda share, doing: None)
