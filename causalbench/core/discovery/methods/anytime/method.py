"""`anytime`: what is known of an edge is an e-value, and a stage is measured until every edge of it is decided.

- Where snapshots restore exactly, one state in which setting a_k to 0 changes r_j proves a cause, so only its size is
  in question: an edge is present if its effect T (see `truth/oracle.py`) is above the limit of an absent edge, and
  absent if it is below that of a strong one. Once the steps are spent, the estimate says whether a proven cause is
  large enough, and what never had an effect is absent unless it acts in fewer states than the setting `rare`.
- Where restoring is inexact, every action is tried twice. Under no effect all tries can be exchanged, so that the sign
  of the product of both differences, and that of the difference of both spreads, is a fair coin.
- Without snapshots random samples are tested as `hrt` does; what they do not prove is undecided.

E-values allow a look after every state. `level` is the chance of any wrong edge in the whole graph, `miss` that of
calling a strong edge absent. Edges that no evidence decides within the steps are undecided. Only actions with undecided
edges are measured.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt, Le
from numpy.typing import NDArray

from causalbench.core.discovery.graph import EvidenceColumn, StageGraph
from causalbench.core.discovery.methods import hrt
from causalbench.core.discovery.methods.anytime import betting
from causalbench.core.discovery.methods.anytime.pairs import Pairs
from causalbench.core.discovery.registry import RANDOM, Discoverer, StageProblem
from causalbench.core.discovery.samples.transitions import varies
from causalbench.core.discovery.truth.effects import ABSENT_BELOW, RULE_OF_THREE, STRONG_ABOVE
from causalbench.core.world.capabilities import Capability
from causalbench.errors import UndecidedStageError

Array = NDArray[np.float64]

LEAST_SEQUENCES = 5  # before anything is decided, since the variance of a reward is known from sequences
NEXT_LOOK = 1.1  # growth from look to look, to save time alone: e-values allow any number
NO_SNAPSHOTS = "nothing can be restored here: random samples were tested, which prove no edge absent"
STREAM = 104  # beside the numbers of the sets of samples and of the other discoverers
GRID = np.geomspace(1e-4, 10.0, 61)
"""Effect sizes among which an interval's ends are found."""


@dataclass(frozen=True)
class AnytimeSettings:
    """Own settings of `anytime`."""

    max_actions: Annotated[int, Gt(0)] = 750  # most that are tried in one stage where snapshots restore exactly
    max_actions_inexact: Annotated[int, Gt(0)] = 4_000  # and where they do not
    level: Annotated[float, Gt(0), Le(1)] = 0.05  # chance of any wrong edge in the whole graph
    miss: Annotated[float, Gt(0), Le(1)] = 0.1  # chance of calling one strong edge absent
    # Share of states: what acts in fewer is absent once the steps are spent.
    rare: Annotated[float, Gt(0), Le(1)] = 0.02


class Verdicts:
    """The edges of one stage: log e-values for and against each, and what they decide."""

    def __init__(self, pairs: Pairs, level: float, miss: float, rare: float) -> None:
        self.pairs, self.least = pairs, RULE_OF_THREE / rare
        self.bars = math.log(1.0 / level), math.log(1.0 / miss)
        self.present, self.absent = np.zeros(pairs.shape, dtype=bool), np.zeros(pairs.shape, dtype=bool)
        self.event = np.ones(pairs.shape[1])
        self.effect, self.low, self.high, self.e_value, self.states = (np.zeros(pairs.shape) for _ in range(5))

    @property
    def open(self) -> NDArray[np.bool_]:
        """(n_actions, n_terms) whether an edge is undecided."""
        return ~(self.present | self.absent)

    def look(self, last: bool = False) -> None:
        """Decide what the states so far allow, action by action, since each has been measured in states of its own.

        Nothing is said of a term that had an effect and has not varied yet: an effect is a share of its variance.
        """
        varied, measured = varies(np.array(self.pairs.taken)), np.array(self.pairs.measured)
        squares = np.array([compared.square for compared in self.pairs.compared])
        variance = np.where(varied, self.pairs.variance, np.inf)
        can_tell, sizes = varied | (squares == 0.0).all((0, 1)), squares / variance
        spreads = np.array([compared.spread for compared in self.pairs.compared]) / variance
        self.event = _event(sizes)
        for k in np.flatnonzero((self.open & can_tell).any(1)):
            self._judge(int(k), can_tell, sizes[measured[:, k], k], spreads[measured[:, k], k], last)

    def close(self) -> None:
        """What exact snapshots say of the edges that are open once the steps are spent.

        Whatever had an effect is a cause, and counts if the effect is large enough by its estimate; whatever never had
        one is absent, if it was measured in so many states that an effect in a share `rare` of them would have shown.
        """
        if self.pairs.exact:
            self.present |= self.open & (self.effect > math.sqrt(ABSENT_BELOW * STRONG_ABOVE))
            self.absent |= self.open & (self.effect == 0.0) & (self.states >= self.least)

    def _judge(self, k: int, can_tell: NDArray[np.bool_], sizes: Array, spreads: Array, last: bool) -> None:
        still = self.open[k] & can_tell
        found = self._for(sizes, spreads, ABSENT_BELOW)
        against = self._against(sizes, STRONG_ABOVE)
        self.effect[k, still], self.states[k, still] = sizes.mean(0)[still], len(sizes)
        self.e_value[k, still] = found[still]
        self.present[k] |= still & (found >= self.bars[0])
        unseen = self.pairs.exact & (sizes == 0.0).all(0) & (len(sizes) < self.least)
        self.absent[k] |= still & ~self.present[k] & (against >= self.bars[1]) & ~unseen
        closed = still & ~self.open[k]
        self._bound(k, still if last else closed, sizes)

    def _for(self, sizes: Array, spreads: Array, limit: float) -> Array:
        if self.pairs.exact:
            return betting.above(sizes, limit)
        return betting.either(betting.positive(sizes - limit), betting.positive(spreads, both_signs=True))

    def _against(self, sizes: Array, limit: float) -> Array:
        if self.pairs.exact:
            return betting.below(sizes, limit, self.event)
        return _asymptotic(sizes, limit)

    def _bound(self, k: int, edges: NDArray[np.bool_], sizes: Array) -> None:
        """The effect sizes that are left at `miss` for some `edges` (n_terms,) of action k."""
        if not edges.any():
            return
        nothing = np.zeros_like(sizes)
        above = np.array([self._for(sizes, nothing, limit) >= self.bars[1] for limit in GRID])
        below = np.array([self._against(sizes, limit) >= self.bars[1] for limit in GRID])
        low = np.where(above.any(0), GRID[len(GRID) - 1 - above[::-1].argmax(0)], 0.0)
        high = np.where(below.any(0), GRID[below.argmax(0)], GRID[-1])
        self.low[k, edges], self.high[k, edges] = low[edges], np.fmax(low, high)[edges]


def _event(sizes: Array) -> Array:
    """(n_terms,) what an event does where there is one, in variances of the term; at least 1."""
    shown = sizes > ABSENT_BELOW
    return np.fmax(1.0, np.where(shown, sizes, 0.0).sum((0, 1)) / np.fmax(shown.sum((0, 1)), 1))


def _asymptotic(values: Array, limit: float) -> Array:
    """Log of how far the mean lies below `limit`, at any time, of many `values` (Robbins 1970, normal mixture)."""
    n, sd = len(values), np.fmax(values.std(0), 1e-300)
    z = math.sqrt(n) * np.fmax(limit - RULE_OF_THREE / n - values.mean(0), 0.0) / sd
    return np.asarray(0.5 * z**2 * n / (n + PRIOR) - 0.5 * math.log1p(n / PRIOR))


PRIOR = 20.0  # states at which the mixture is tightest


def discover_stage(problem: StageProblem) -> StageGraph:
    """Decide the edges of one stage, with at most `max_actions` actions, or from samples where nothing restores."""
    if Capability.RESTORE not in problem.world().capabilities:
        return _from_samples(problem)
    rng = np.random.default_rng([problem.seed, problem.stage, STREAM])
    pairs = Pairs(problem.walk(rng))
    verdicts = _measured(problem, pairs)
    problem.keep("pairs", pairs.trials.samples(pairs.refused))
    return _graph(problem, verdicts)


def _from_samples(problem: StageProblem) -> StageGraph:
    """The graph of what random samples prove; they prove no absence."""
    log_e, testable = hrt.evidence_of(problem, hrt.HRTSettings().redraws), problem.samples().random.term_scale()[1]
    present = log_e >= math.log(log_e.size * problem.task.n_stages / problem.options.level)
    nothing = {name: np.zeros_like(log_e) for name in ("effect", "effect_low", "effect_high", "pairs")}
    return StageGraph.decided(
        problem.task, problem.stage, present, testable, nothing | {"log_e": log_e}, (NO_SNAPSHOTS,), ~present
    )


def _measured(problem: StageProblem, pairs: Pairs) -> Verdicts:
    own, task = problem.options, problem.task
    edges = sum(
        len(task.actions) * len(task.stage_terms(stage, discoverable_only=True))
        for stage in range(1, task.n_stages + 1)
    )
    verdicts = Verdicts(pairs, own.level / edges, own.miss, own.rare)
    budget = (own.max_actions if pairs.exact else own.max_actions_inexact) * pairs.walk.action_repeat
    next_look = 0.0
    while verdicts.open.any() and pairs.trials.env_steps + pairs.most <= budget:
        pairs.visit(verdicts.open)
        if pairs.walk.sequence >= LEAST_SEQUENCES and pairs.visited >= next_look:
            verdicts.look()
            next_look = pairs.visited * NEXT_LOOK
        problem.report(pairs.trials.env_steps / budget, f"{int(verdicts.open.sum())} edges undecided")
    verdicts.look(last=True)
    verdicts.close()
    if pairs.refused > len(pairs.taken):
        raise UndecidedStageError(f"{pairs.refused} of {pairs.visited} states were not finite")
    return verdicts


def _graph(problem: StageProblem, verdicts: Verdicts) -> StageGraph:
    pairs, task = verdicts.pairs, problem.task
    testable = varies(np.array(pairs.taken))
    evidence = {
        "effect": verdicts.effect,
        "effect_low": verdicts.low,
        "effect_high": verdicts.high,
        "log_e": verdicts.e_value,
        "pairs": verdicts.states,
    }
    notes = tuple(
        f"{task.actions[k]} on {problem.terms[j]} was not decided within the budget"
        for k, j in np.argwhere(verdicts.open & testable)
    )
    return StageGraph.decided(task, problem.stage, verdicts.present, testable, evidence, notes, verdicts.open)


DISCOVERER = Discoverer(
    "anytime",
    discover_stage,
    "an e-value for every edge, until each is decided",
    settings=AnytimeSettings,
    evidence=(
        EvidenceColumn("effect", "", "estimate of E[(r_j(s, a) - r_j(s, a with a_k = 0))^2] / Var(r_j)", main=True,
                       log_range=(1e-3, 2.0)),
        EvidenceColumn("effect_low", "", "least effect that is left at the setting `miss`"),
        EvidenceColumn("effect_high", "", "largest effect that is left at the setting `miss`"),
        EvidenceColumn("log_e", "nats", "log of the e-value against the hypothesis that the effect is absent"),
        EvidenceColumn("pairs", "states", "states in which the action was compared with 0 until the edge was decided"),
    ),
    reads=RANDOM,
)  # fmt: skip
