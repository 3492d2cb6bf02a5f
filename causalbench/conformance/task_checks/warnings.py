"""What makes a decomposition a bad one, though it keeps the contract: warnings, not failures."""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from causalbench.conformance.bench import expect
from causalbench.conformance.task_bench import TaskBench, expert
from causalbench.core.discovery.truth.oracle import Grade, StageTruth, consult_oracle
from causalbench.core.learners.scalars import Scalar, make_scalar
from causalbench.core.staged.restricted_expert import solved_starts
from causalbench.core.staged.worlds import Step, Worlds

STARTS = 20  # in a stage, or episodes
STATES = 60  # that the oracle tries actions in, in every stage
AT_ONCE = 0.75  # share of starts that are left in one step
HALF = 0.5
MATTERS = (Grade.weak, Grade.strong)


def w01_left_at_once(bench: TaskBench) -> None:
    """W1. No stage is left in its first step whatever the agent does.

    In one step, from less than 75% of 20 starts, under random actions or under the expert's.
    """
    for stage in bench.starts:
        shares = [np.mean([int(step.next_stage) != stage for step in _firsts(bench, stage, act)]) for act in (0, 1)]
        expect(
            min(shares) < AT_ONCE,
            f"stage {stage} is left in one step from {shares[0]:.0%} of starts by random actions and from "
            f"{shares[1]:.0%} by the expert: it decides nothing, make it a part of another stage",
        )


def _firsts(bench: TaskBench, stage: int, scripted: int) -> Iterator[Step]:
    """The first step from each start of a stage, by the expert or at random."""
    for seed in range(STARTS):
        rng = np.random.default_rng(seed)
        bench.worlds.reset([0], [rng], stage)
        yield bench.worlds.step(expert(bench.worlds) if scripted else rng.uniform(-1.0, 1.0, len(bench.task.actions)))


def w02_causes(bench: TaskBench) -> None:
    """W2. Every term that varies has a cause: some action matters to it in the oracle's 60 states of the stage."""
    for truth in _truth(bench):
        for column, name in enumerate(truth.terms):
            grades = {row[column] for row in truth.grades()}
            expect(
                grades != {Grade.absent},
                f"{name} varies in stage {truth.stage}, but no action matters to it: it pays for where a step begins, "
                "for chance or for what comes of it later",
            )


def w03_enough(bench: TaskBench) -> None:
    """W3. The causes of a stage's terms are enough to leave it: the expert does so with all other actions at 0.

    From at least half as many of 20 starts as with all actions.
    """
    task, sets = bench.task, _causes(bench)
    everything = dict.fromkeys(bench.stages, task.actions)
    worlds = bench.make(STARTS if bench.worlds.steps_as_one else 1)
    for stage in bench.starts:
        solved, free = (int(solved_starts(worlds, stage, s, STARTS).sum()) for s in (sets, everything))
        expect(
            solved >= HALF * free,
            f"stage {stage} is solved from {solved} of {STARTS} starts on the causes of its terms "
            f"({', '.join(sorted(sets[stage])) or 'none'}) and from {free} on all: no term pays for what it takes",
        )


def w04_no_farming(bench: TaskBench) -> None:
    """W4. Going back and forth over the border of a stage earns less than success, in the one reward of a learner.

    That scalar is the change of the potential, or the sum of the terms where there is none; 200 steps at most.
    """
    for stage in bench.starts:
        done, farmed = (_earned(bench, stage, turns) for turns in (False, True))
        expect(
            farmed <= done,
            f"from stage {stage} on, going to and fro earns {farmed:.1f} and the expert {done:.1f}: declare a "
            "potential whose change stands for the terms that pay again, or let no term do so",
        )


def w05_reached(bench: TaskBench) -> None:
    """W5. Every stage occurs in at least one of 20 episodes of the expert."""
    seen = {int(stage) for trace in _episodes(bench) for stage in trace}
    missed = sorted({*bench.stages} - seen)
    expect(not missed, f"no episode came by stage {', '.join(map(str, missed))}: nothing is learned there")


def w06_vary_at_random(bench: TaskBench) -> None:
    """W6. Every term that discovery may use varies under random actions in each of its stages."""
    for truth in _truth(bench):
        constant = [name for j, name in enumerate(truth.terms) if np.isnan(truth.effect[:, j]).all()]
        expect(
            not constant,
            f"{', '.join(constant)} never varied in stage {truth.stage} under random actions: discovery sees no causes",
        )


def w07_forward(bench: TaskBench) -> None:
    """W7. From start to success the expert goes only to later stages, in at least half of 20 episodes."""
    back = [trace for trace in _episodes(bench) if (np.diff(trace) < 0).any()]
    expect(
        len(back) <= HALF * STARTS,
        f"{len(back)} of {STARTS} episodes of the expert fall back, such as through the stages "
        f"{' '.join(str(s) for i, s in enumerate(back[0] if back else []) if not i or s != back[0][i - 1])}: "
        "are they numbered in the order of the work?",
    )


@functools.lru_cache(maxsize=1)
def _truth(bench: TaskBench) -> tuple[StageTruth, ...]:
    return consult_oracle(bench.task, bench.make_worlds, STATES, 0, lambda share, text: None)


def _causes(bench: TaskBench) -> dict[int, frozenset[str]]:
    """Stage -> the actions that matter to any of its terms; those that the task declares for one that never varied."""
    found = {}
    for truth in _truth(bench):
        declared = bench.task.manual_graph.get(truth.stage, {})
        names: set[str] = set()
        for column, term in enumerate(truth.terms):
            grades = [row[column] for row in truth.grades()]
            matter = {name for name, grade in zip(truth.actions, grades, strict=True) if grade in MATTERS}
            names |= declared.get(term, frozenset()) if Grade.untestable in grades else matter
        found[truth.stage] = frozenset(names)
    return found


@functools.lru_cache(maxsize=1)
def _episodes(bench: TaskBench) -> list[NDArray[np.int64]]:
    """The stages that each episode of the expert comes by."""
    found = []
    for seed in range(STARTS):
        bench.worlds.reset([0], [np.random.default_rng(seed)])
        trace = []
        for _ in range(bench.task.horizon):
            step = bench.worlds.step(expert(bench.worlds))
            trace.append(int(step.stage))
            if step.terminated:
                break
        found.append(np.array(trace))
    return found


def _earned(bench: TaskBench, stage: int, turns: bool) -> float:
    """What the expert earns from a start of a stage on, who with `turns` undoes each step into a later stage."""
    worlds = bench.make(1)
    worlds.reset([0], [np.random.default_rng(stage)], stage)
    scalar = make_scalar("shaped" if bench.task.potential else "paper", bench.task, 1, 1.0)
    total, undo = 0.0, np.zeros(len(bench.task.actions))
    for _ in range(bench.task.horizon):
        wanted = undo if undo.any() else np.clip(np.nan_to_num(worlds.expert()), -1.0, 1.0)[0]
        step, paid = _paid(worlds, wanted, scalar)
        total += paid
        if step.terminated[0]:
            break
        undo = -wanted if turns and step.next_stage[0] > step.stage[0] else np.zeros_like(undo)
    return total


def _paid(worlds: Worlds, wanted: NDArray[np.float64], scalar: Scalar) -> tuple[Step, float]:
    """One step of one world of shape (1,), and what a learner is paid for it."""
    before = worlds.observe()
    step = worlds.step(wanted[None])
    infos = {
        "vector_reward": step.rewards,
        "stage": step.stage,
        "next_stage": step.next_stage,
        "is_success": step.success,
        "terminated": step.terminated,
        "final_obs": worlds.observe(),
    }
    return step, float(scalar(before, infos, step.terminated)[0])
