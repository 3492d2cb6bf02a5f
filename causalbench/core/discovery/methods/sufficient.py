"""As few causes as are enough: `paired`, then which of the causes a stage needs, by random sequences on some of them.

Whatever can change a reward is a cause, and an agent that sets all causes has as many ways to spoil a stage as to
solve it. What is left at 0 spoils nothing. So random sequences set a random half of the causes and leave the others at
0; those causes with which sequences finish the stage oftener than without are chosen, and a last trial says whether
random sequences on them alone finish it no less often than with all actions: a test of non-inferiority, since two equal
shares would be called unequal half of the time. If so, they are enough.

Where sequences hardly finish the stage there is nothing to compare, and all causes stay. The causal matrix is that of
`paired` in any case; only the actions that a policy sets are fewer (`StageGraph.sufficient`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.graph import StageGraph
from causalbench.core.discovery.methods.paired import EVIDENCE, PairedSettings, measure
from causalbench.core.discovery.registry import NO_SAMPLES, Discoverer, StageProblem
from causalbench.core.world.capabilities import Capability

if TYPE_CHECKING:
    from causalbench.core.discovery.truth.counterfactual import Walk

HALVES, TRIALS = 120, 40  # sequences on a random half of the causes, and on the chosen ones
EXPECTED = 8  # of HALVES that must finish; a cause stands out from 5 to 0 on, which 8 expected ones show in nine of ten
LEVEL = 0.05  # chance that a cause which does not matter is chosen
MARGIN = 0.5  # of how often all actions finish: what random sequences may lose by leaving actions at 0
Z = 1.6448536269514722  # of the standard normal, one-sided 95%
STREAM = 103  # beside the numbers of the sets of samples and of the other discoverers


def discover_stage(problem: StageProblem) -> StageGraph:
    """The graph of `paired` with the causes that are enough; up to 160 sequences more where there is a choice."""
    graph, walk = measure(problem)
    causes = graph.causal_actions()
    if HALVES * walk.finished < EXPECTED * walk.ended:
        few = f"{walk.finished} of {walk.ended} random sequences finished the stage"
        return _with_note(graph, f"{few}, too few to compare sets of causes by: all stay")
    rng = np.random.default_rng([problem.seed, problem.stage, STREAM])
    is_cause = np.isin(graph.actions, causes)
    sets = is_cause & (rng.random((HALVES, len(is_cause))) < 0.5)
    tried = problem.walk(rng)
    finished = np.array([_finishes(tried, chosen) for chosen in sets])
    chosen = is_cause & np.array([_oftener(finished[on], finished[~on]) for on in sets.T])
    names = tuple(a for a, enough in zip(graph.actions, chosen, strict=True) if enough)
    if not names or names == causes:
        return _with_note(graph, "no cause stands out where a random half of them finished the stage: all stay")
    hits = sum(_finishes(tried, chosen) for _ in range(TRIALS))
    said = f"random {' '.join(names)} finished the stage {hits} times of {TRIALS}"
    said += f", all actions {walk.finished} of {walk.ended}"
    if not no_less(hits, TRIALS, walk.finished, walk.ended):
        return _with_note(graph, f"{said}: too few, so all causes stay")
    return _with_note(replace(graph, sufficient=names), f"{said}: enough for a policy")


def _finishes(walk: Walk, chosen: NDArray[np.bool_]) -> bool:
    """Whether the next random sequence on the `chosen` actions (n_actions,), the others at 0, finishes the stage."""
    ended, finished = walk.ended, walk.finished
    while walk.ended == ended:
        walk.take(walk.visit() * chosen)
    return walk.finished > finished


def no_less(hits: int, n: int, others: int, m: int) -> bool:
    """Whether `hits` of `n` is, with 95% confidence, more than `MARGIN` of the share `others` of `m`.

    The bound of the difference is made of Wilson's one-sided bounds of both shares (Newcombe 1998).
    """
    low, share = _wilson(hits, n)[0], hits / n
    high, other = _wilson(others, m)[1], others / m
    return share - MARGIN * other > math.hypot(share - low, MARGIN * (high - other))


def _wilson(hits: int, n: int) -> tuple[float, float]:
    """Wilson's lower and upper bound of a share, each with 95% confidence."""
    middle, square = (hits + Z**2 / 2) / (n + Z**2), Z**2 / (n + Z**2)
    half = math.sqrt(square * (hits * (n - hits) / n**2 * n / (n + Z**2) + square / 4))
    return middle - half, middle + half


def _oftener(these: NDArray[np.bool_], those: NDArray[np.bool_]) -> bool:
    """Fisher's exact test, one-sided, at `LEVEL`: is the share of True larger among `these` than among `those`?"""
    from scipy.stats import fisher_exact  # takes a third of a second to import

    table = [[int(shares.sum()), int((~shares).sum())] for shares in (these, those)]
    return bool(fisher_exact(table, alternative="greater").pvalue < LEVEL)


def _with_note(graph: StageGraph, note: str) -> StageGraph:
    return replace(graph, notes=(*graph.notes, note))


DISCOVERER = Discoverer(
    "sufficient",
    discover_stage,
    "as paired, then as few of the causes as finish the stage",
    settings=PairedSettings,
    evidence=EVIDENCE,
    reads=NO_SAMPLES,
    requires=frozenset({Capability.RESTORE}),
)
