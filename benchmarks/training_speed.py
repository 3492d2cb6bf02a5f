"""Env steps per second of whole training, updates included: python benchmarks/training_speed.py (4 minutes).

The staged learners beside stable-baselines3's own agents on the same environment, with the same networks, batch and
update ratio, one world, in turns A B A B; medians of processor time, evaluation left out. SAC updates once for four new
samples, PPO passes ten times over 512 steps.
"""

from __future__ import annotations

import contextlib
import statistics
import time

import torch

from causalbench.core.discovery.graph import manual_graph
from causalbench.core.learners.methods import METHODS
from causalbench.core.learners.registry import TrainingProblem
from causalbench.core.learners.settings import EvaluationSettings
from causalbench.core.staged.worlds import MakeWorlds
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.plugins.manager import installed
from causalbench.plugins.venues import worlds_maker

STEPS, TURNS = 1_500, 3
CHANGED = {"SAC": {"learning_starts": 100}, "PPO": {"n_steps": 512}}
METHOD = {method.name: method for method in METHODS}
RIVALS = ("SAC", "mSAC", "cmmSAC", "PPO", "mPPO", "cmmPPO")


class Enough(Exception):  # noqa: N818 - no error: ends training before its evaluation
    """The last step is done."""


def seconds(name: str, make_worlds: MakeWorlds, seed: int) -> float:
    """Processor seconds per env step of one training from its first step."""
    started = time.thread_time()

    def on_progress(share: float, _: str) -> None:
        if share >= 1:
            raise Enough

    method = METHOD[name]
    learner = installed().learner(method.learner)
    settings, rarely = learner.settings(**CHANGED[name[-3:]]), EvaluationSettings(every=10 * STEPS)
    graph = manual_graph(TASK) if method.matrix == "manual" else None
    problem = TrainingProblem(
        TASK, make_worlds, method, graph, settings, rarely, STEPS, seed, lambda *_: None, on_progress
    )
    with contextlib.suppress(Enough):
        learner.train(problem)
    return (time.thread_time() - started) / STEPS


def main() -> None:
    """Print one block per backend."""
    torch.set_num_threads(1)
    for backend in ("kinematic", "gymrob"):
        make_worlds = worlds_maker(installed().backend(backend), TASK)
        turns = [{name: seconds(name, make_worlds, seed) for name in RIVALS} for seed in range(TURNS)]
        medians = {name: statistics.median(turn[name] for turn in turns) for name in RIVALS}
        print(f"{backend}, networks 64-64")
        for name, taken in medians.items():
            print(f"  {name:7s} {1 / taken:5.0f} env steps/s, {medians[name[-3:]] / taken:.2f} of SB3's")


if __name__ == "__main__":
    main()
