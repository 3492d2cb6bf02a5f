"""Algorithm 1 of the paper: for every stage collect, fit the reward models, compare, select."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from dataclasses import asdict

import numpy as np
import torch
from numpy.typing import NDArray

from causalbench.core.batch import BatchScene, make_batch
from causalbench.core.discovery.collect import Samples, collect
from causalbench.core.discovery.divergence import Divergence, divergence
from causalbench.core.discovery.graph import CausalGraph, StageGraph, declared_matrix
from causalbench.core.discovery.reward_model import term_scale, train_reward_models
from causalbench.core.discovery.select import select_causal_actions
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.scene import Scene
from causalbench.core.tasks.task import Task

Progress = Callable[[float, str], None]

COLLECT_SHARE = 0.7
"""Share of a stage's progress bar that collecting takes; for people only."""


def discover(
    task: Task, make_scene: Callable[[], Scene], settings: DiscoverySettings, seed: int, on_progress: Progress
) -> CausalGraph:
    """Discover the causal matrices of every stage of `task` (Algorithm 1); deterministic in `seed`.

    `on_progress(share done, what is being done)` is called often. The graph counts every env step taken.
    """
    batch = make_batch(make_scene, N_WORLDS)
    try:
        results = [
            _discover_stage(task, batch, stage, settings, seed, on_progress) for stage in range(1, task.n_stages + 1)
        ]
    finally:
        batch.close()
    digest = hashlib.sha256("".join(data for _, _, data in results).encode()).hexdigest()
    spec = batch.spec
    return CausalGraph(
        task=task.name,
        task_version=task.version,
        origin="discovered",
        stages=tuple(graph for graph, _, _ in results),
        env_steps=sum(steps for _, steps, _ in results),
        provenance={
            "backend": f"{spec.backend} {spec.backend_version}",
            "engine": f"{spec.engine} {spec.engine_version}",
            "robot": spec.robot,
            "seed": seed,
            "settings": asdict(settings),
            "data_sha256": digest,
            "versions": {"python": sys.version.split()[0], "numpy": np.__version__, "torch": torch.__version__},
        },
    )


N_WORLDS = 16
"""Worlds of a backend that steps in batches; sequences have a fixed length, so the number changes no distribution."""


def _discover_stage(
    task: Task, batch: BatchScene, stage: int, settings: DiscoverySettings, seed: int, on_progress: Progress
) -> tuple[StageGraph, int, str]:
    """(graph of the stage, env steps taken, digest of its data)."""
    terms = task.stage_terms(stage, discoverable_only=True)
    n_actions = len(task.actions)
    inference_count = round(settings.inference_fraction * settings.training_count)
    planned = (1 + n_actions + bool(settings.n_placebos)) * settings.training_count + inference_count
    steps = 0

    def report(share_of_stage: float, doing: str) -> None:
        on_progress((stage - 1 + share_of_stage) / task.n_stages, f"stage {stage}: {doing}")

    def on_step(n: int) -> None:
        nonlocal steps
        steps += n
        report(COLLECT_SHARE * min(1.0, steps / planned), "collecting")

    def gather(count: int, stream: int, do: int | None) -> Samples:
        rng = np.random.default_rng([seed, stage, stream])
        return collect(task, batch, stage, count, do, rng, settings.sequence_length, settings.n_placebos, on_step)

    random = gather(settings.training_count, 0, None)
    inference = gather(inference_count, 1, None)
    interventions = [gather(settings.training_count, 2 + k, k) for k in range(n_actions)]
    if settings.n_placebos:
        # No scene sees a placebo, so holding one at 0 is just another random draw with its column set to 0.
        unaffected = gather(settings.training_count, 2 + n_actions, None)
        interventions += [unaffected.without(n_actions + p) for p in range(settings.n_placebos)]
    models = train_reward_models(
        random,
        interventions,
        settings,
        seed + stage,
        lambda share: report(COLLECT_SHARE + (1 - COLLECT_SHARE) * share, "fitting reward models"),
    )
    pairs = [
        divergence(*models.predict(inference.without(k), k), *models.predict(inference, k), settings.sigma_kl)
        for k in range(len(interventions))
    ]
    kl = Divergence(*(torch.stack(column) for column in zip(*pairs, strict=True)))
    graph = _select_stage(task, stage, terms, kl, term_scale(random)[1], settings)
    digest = "".join(samples.digest() for samples in (random, inference, *interventions))
    return graph, steps, digest


def _select_stage(
    task: Task,
    stage: int,
    terms: tuple[str, ...],
    kl: Divergence,
    testable: NDArray[np.bool_],
    settings: DiscoverySettings,
) -> StageGraph:
    """Algorithm 2 on every term, then the placebo gate; `kl` is (n_actions + n_placebos, n_terms)."""
    k = len(task.actions)
    used = np.asarray(getattr(kl, settings.direction)).clip(min=0.0)
    matrix = declared_matrix(task, stage, terms)
    cv, normalised = np.zeros(len(terms)), np.zeros((k, len(terms)))
    placebo = used[k:].max(0) if settings.n_placebos else None
    for j in range(len(terms)):
        choice = select_causal_actions(
            used[:k, j], settings.epsilon_cv, settings.epsilon_normalize, settings.epsilon_direct
        )
        cv[j], normalised[:, j] = choice.cv, choice.normalised
        if testable[j]:
            matrix[:, j] = choice.selected
            if placebo is not None:
                matrix[:, j] &= used[:k, j] > settings.placebo_gate * placebo[j]
    forward, reverse, symmetric = (np.asarray(values)[:k] for values in kl)
    return StageGraph(
        stage, task.actions, terms, matrix, forward, reverse, symmetric, normalised, cv, placebo, testable
    )
