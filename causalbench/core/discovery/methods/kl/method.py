"""The paper's discoverer: KL between the reward models p(r | s, do(a_k = 0)) and p(r | s, random a_k), Algorithm 2."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.graph import EvidenceColumn, StageGraph
from causalbench.core.discovery.methods.kl.placebos import calibrate, placebo_copy
from causalbench.core.discovery.methods.kl.select import select_causal_actions
from causalbench.core.discovery.methods.kl.settings import PRESETS, KLSettings
from causalbench.core.discovery.registry import Discoverer, StageProblem
from causalbench.errors import UserError

if TYPE_CHECKING:
    from causalbench.core.discovery.methods.kl.divergence import Divergence
    from causalbench.core.discovery.reward_model.models import RewardModels
    from causalbench.core.discovery.samples.transitions import Samples, StageSamples

Array = NDArray[np.float64]

PLACEBO_STREAM = 1000
"""Number, beside seed and stage, of the generator that draws placebos; those of collecting are small."""

EVIDENCE = (
    EvidenceColumn("kl", "nats", "KL divergence in the direction that Algorithm 2 saw (setting `direction`)", main=True,
                   log_range=(1e-4, 12.5)),  # 12.5: a shift of the mean by one deviation, at the default floor of sigma
    EvidenceColumn("kl_forward", "nats", "KL(P1||P2); P1 = p(r | s, do(a_k = 0)), P2 = p(r | s, random a_k)"),
    EvidenceColumn("kl_reverse", "nats", "KL(P2||P1)"),
    EvidenceColumn("kl_symmetric", "nats", "mean of both directions"),
    EvidenceColumn("kl_normalised", "", "kl from 0 for the smallest to 1 for the largest of the reward's actions"),
    EvidenceColumn("q_value", "", "least false-discovery rate at which the placebos would let the edge be selected"),
    EvidenceColumn("cv", "", "coefficient of variation of the reward's kl values", per="term"),
    EvidenceColumn("null_kl", "nats", "kl of every placebo in every set, (n_nulls, n_terms)", per="stage"),
)  # fmt: skip


class Probes(NamedTuple):
    """What the models say of a stage: KLs of all pairs, and of the placebos in the direction that is used."""

    kl: Divergence  # each (n_actions, n_terms)
    null_kl: Array | None  # (n_nulls, n_terms), None without placebos


def discover_stage(problem: StageProblem) -> StageGraph:
    """Fit the reward models of every (action, term) pair, compare them on D_inference and select."""
    from causalbench.core.discovery.reward_model.fit import train_reward_models

    own: KLSettings = problem.options
    if own.select == "fdr" and not problem.settings.n_placebos:
        raise UserError("discovery: `select: fdr` learns its cut from placebos; set n_placebos to at least 1")
    data = problem.samples()
    training = _training_sets(problem, data, own)
    models = train_reward_models(
        training, own, problem.seed + problem.stage, lambda share: problem.report(share, "fitting reward models")
    )
    probes = _probe(models, data.inference, len(training), len(data.interventions), problem.settings.n_placebos, own)
    return _select(problem, probes, data.random.term_scale()[1])


def _training_sets(problem: StageProblem, data: StageSamples, own: KLSettings) -> list[tuple[Samples, Samples]]:
    """D_random with each D_do[a_k], then `placebo_sets` copies of it and of the extra set, placebos drawn anew."""
    n_actions = len(data.interventions)
    training = [(data.random, do) for do in data.interventions]
    if data.extra is not None:
        rng = np.random.default_rng([problem.seed, problem.stage, PLACEBO_STREAM])
        zeros = 0.25 if problem.settings.intervene == "step" else 0.5
        for _ in range(own.placebo_sets):
            random, extra = (placebo_copy(s, n_actions, zeros, rng) for s in (data.random, data.extra))
            training.append((random, extra))
    return training


def _probe(
    models: RewardModels, inference: Samples, n_models: int, n_actions: int, n_placebos: int, own: KLSettings
) -> Probes:
    """Compare each model's prediction on D_inference with that on its copy without the action."""
    import torch  # here, so that a list of discoverers costs no import of torch

    from causalbench.core.discovery.methods.kl.divergence import Divergence, divergence

    def probe(model: int, action: int) -> Divergence:
        without = models.predict(inference.without(action), model)
        return divergence(*without, *models.predict(inference, model), own.sigma_kl)

    def probe_all(pairs: list[tuple[int, int]]) -> Divergence:
        return Divergence(*(torch.stack(column) for column in zip(*(probe(*pair) for pair in pairs), strict=True)))

    kl = probe_all([(k, k) for k in range(n_actions)])
    if not n_placebos:
        return Probes(kl, None)
    placebos = range(n_actions, n_actions + n_placebos)
    nulls = probe_all([(model, p) for model in range(n_actions, n_models) for p in placebos])
    return Probes(kl, np.asarray(getattr(nulls, own.direction)).clip(min=0.0))


def _select(problem: StageProblem, probes: Probes, testable: NDArray[np.bool_]) -> StageGraph:
    """Algorithm 2 on every term, then the placebo gate."""
    task, stage, own = problem.task, problem.stage, problem.options
    terms = problem.terms
    used = np.asarray(getattr(probes.kl, own.direction))
    present = np.zeros((len(task.actions), len(terms)), dtype=bool)
    cv, normalised = np.zeros(len(terms)), np.zeros((len(task.actions), len(terms)))
    for j in range(len(terms)):
        kl = used[:, j].clip(min=0.0)
        choice = select_causal_actions(kl, own.epsilon_cv, own.epsilon_normalize, own.epsilon_direct)
        cv[j], normalised[:, j] = choice.cv, choice.normalised
        present[:, j] = choice.selected
        if probes.null_kl is not None:
            present[:, j] &= kl > own.placebo_gate * probes.null_kl[:, j].max()
    forward, reverse, symmetric = map(np.asarray, probes.kl)
    evidence = {"kl": used, "kl_forward": forward, "kl_reverse": reverse, "kl_symmetric": symmetric}
    evidence |= {"kl_normalised": normalised, "cv": cv}
    if probes.null_kl is not None:
        evidence["null_kl"] = probes.null_kl
    return StageGraph.decided(task, stage, present, testable, evidence)


DISCOVERER = Discoverer(
    "kl",
    discover_stage,
    "KL of reward models with and without the action (the paper)",
    settings=KLSettings,
    presets=PRESETS,
    evidence=EVIDENCE,
    finish=calibrate,
)
