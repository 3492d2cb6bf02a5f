"""Null edges: how large a KL is where there is no cause, and the cut that keeps a stated false-discovery rate.

A placebo is an action dimension that no scene sees. Its column of the data is ours to draw, so that one extra random
set serves any number of placebos: in each of `placebo_sets` copies of it and of D_random every placebo is drawn anew
and is 0 in as many rows as a real action is in D_random and D_do together: a quarter, or a half where D_do holds it at
0 throughout. A model fitted on such a copy
is probed once per placebo.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.graph import StageGraph
from causalbench.core.discovery.samples.transitions import Samples
from causalbench.core.discovery.settings import DiscoverySettings

Floats = NDArray[np.float64]

TAIL = 0.1  # share of the nulls that the tail is fitted to


def placebo_copy(samples: Samples, n_actions: int, zeros: float, rng: np.random.Generator) -> Samples:
    """The samples with every placebo drawn anew, and 0 in a random share `zeros` of the rows."""
    actions = samples.actions.copy()
    drawn = rng.uniform(-1.0, 1.0, actions[:, n_actions:].shape)
    actions[:, n_actions:] = drawn * (rng.random(drawn.shape) < 1.0 - zeros)
    return replace(samples, actions=actions)


def p_values(kl: Sequence[Floats], null_kl: Sequence[Floats]) -> list[Floats]:
    """The share of all nulls, the edge itself included, that are as large as the edge; beyond them all, a fitted tail.

    One array (n_actions, n_terms) and one (n_nulls, n_terms) per stage. KLs are compared as multiples of the median
    null of their term. Counting alone says no less than 1 / (1 + nulls), with which a rate over all edges could not
    select a single one; so an edge beyond every null gets the Pareto tail of the largest tenth of them (Hill 1975),
    its index one standard error to the safe side, and never more than counting says.
    """
    middles = [np.median(null, axis=0).clip(np.finfo(float).tiny) for null in null_kl]
    nulls = np.sort(np.concatenate([(null / middle).ravel() for null, middle in zip(null_kl, middles, strict=True)]))
    as_large = [nulls.size - np.searchsorted(nulls, edge / middle) for edge, middle in zip(kl, middles, strict=True)]
    counted = [(1 + count) / (1 + nulls.size) for count in as_large]
    tails = [_tail(nulls, edge / middle) for edge, middle in zip(kl, middles, strict=True)]
    return [np.where(n == 0, np.minimum(p, t), p) for n, p, t in zip(as_large, counted, tails, strict=True)]


def _tail(nulls: Floats, ratio: Floats) -> Floats:
    """The chance that a null exceeds `ratio`, which lies above all `nulls` (n,), ascending."""
    most = max(2, math.ceil(TAIL * nulls.size))
    start, beyond = nulls[-most - 1 :][0], nulls[-most:]
    index = np.log(np.fmax(beyond / start, 1.0)).mean() * (1.0 + 1.0 / math.sqrt(most))
    with np.errstate(divide="ignore", over="ignore"):
        return np.asarray(most / nulls.size * np.exp(-np.log(np.fmax(ratio / start, 1.0)) / max(index, 1e-12)))


def q_values(kl: Sequence[Floats], null_kl: Sequence[Floats]) -> list[Floats]:
    """The least false-discovery rate at which each edge would be selected (Benjamini and Hochberg 1995).

    Arguments and result as in `p_values`; all stages are one family.
    """
    from scipy.stats import false_discovery_control  # takes a third of a second to import

    p_of_stage = p_values(kl, null_kl)
    q = false_discovery_control(np.concatenate([values.ravel() for values in p_of_stage]), method="bh")
    sizes = np.cumsum([values.size for values in p_of_stage])[:-1]
    return [part.reshape(values.shape) for part, values in zip(np.split(q, sizes), p_of_stage, strict=True)]


def calibrate(stages: Sequence[StageGraph], settings: DiscoverySettings) -> tuple[StageGraph, ...]:
    """The graphs of all stages with `q_value` wherever nulls were probed, selected by them under `select: fdr`.

    Untestable terms keep their declared column and enter nothing.
    """
    tested = {s.stage: np.asarray(s.testable, dtype=bool) for s in stages if "null_kl" in s.evidence}
    known = [s for s in stages if s.stage in tested and tested[s.stage].any()]
    if not known:
        return tuple(stages)
    columns = [tested[s.stage] for s in known]
    found = q_values(
        [s.evidence["kl"][:, can] for s, can in zip(known, columns, strict=True)],
        [s.evidence["null_kl"][:, can] for s, can in zip(known, columns, strict=True)],
    )
    calibrated: dict[int, StageGraph] = {}
    for stage, can, values in zip(known, columns, found, strict=True):
        q, matrix = np.ones(stage.matrix.shape), stage.matrix.copy()
        q[:, can] = values
        if settings.options.select == "fdr":
            matrix[:, can] = values <= settings.options.fdr
        calibrated[stage.stage] = replace(stage, matrix=matrix, evidence={**stage.evidence, "q_value": q})
    return tuple(calibrated.get(s.stage, s) for s in stages)
