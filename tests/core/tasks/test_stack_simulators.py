"""Stacking in every simulator: starts of each stage, those that hold the box among them, and what the expert leaves."""

from __future__ import annotations

import numpy as np
import pytest

from causalbench.registration import make_env


@pytest.mark.long
def test_the_expert_stacks_from_fifty_starts(backend: str) -> None:
    env = make_env("stack", backend)
    failed = []
    for seed in range(50):
        env.worlds.reset([0], [np.random.default_rng(seed)])
        for _ in range(env.task.horizon):
            step = env.worlds.step(env.worlds.expert())
            if step.terminated:
                break
        if not (step.success and env.worlds.after_success(0)):
            failed.append(seed)
    env.close()
    assert failed == []


def test_a_start_of_each_stage_is_found_and_holds_the_box_in_the_last_two(backend: str) -> None:
    env = make_env("stack", backend)
    for stage in range(1, env.task.n_stages + 1):
        env.worlds.reset([0], [np.random.default_rng(7)], stage)
        assert int(env.worlds.stage) == stage
        assert bool(env.worlds.facts.holding) == (stage >= 5)
    env.close()
