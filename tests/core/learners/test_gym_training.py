"""Learning and discovering on an environment that knows nothing of stages: the mountain car."""

from __future__ import annotations

import dataclasses
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gym_tasks import CAR, CAR_FILE, CAR_THAT_FORGETS, LINE, maker
from training import METHOD

from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.graph import CausalGraph, manual_graph
from causalbench.core.discovery.pipeline import discover
from causalbench.core.discovery.truth.oracle import consult_oracle, oracle_graph
from causalbench.core.learners.checkpoint import Checkpoints
from causalbench.core.learners.evaluation import Player, summary
from causalbench.core.learners.policy import ObservationScale, load_policy
from causalbench.core.learners.ppo.settings import PPOSettings
from causalbench.core.learners.ppo.staged import StagedPPO
from causalbench.core.learners.registry import LEARNERS, Trained, TrainingProblem
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.learners.sac.staged import StagedSAC
from causalbench.core.learners.settings import EvaluationSettings
from causalbench.core.learners.training_graph import training_graph
from causalbench.core.staged.restricted_expert import solved_starts
from causalbench.core.staged.vector_env import StageTaskVectorEnv
from causalbench.core.tasks.gym_task import GymTask
from causalbench.core.tasks.stage_task import causal_sets
from causalbench.errors import UserError

TINY = SACSettings(net_arch=(8, 8), batch_size=16, learning_starts=16, train_every=4, n_envs=2)
WHOLE = dataclasses.replace(
    CAR,
    horizon=40,
    manual_graph=causal_sets(
        {1: {"r_energy": "drive", "r_effort": "drive"}, 2: {"r_speed": "drive", "r_effort": "drive"}}
    ),
)
"""The car with all of its true causes, and short episodes."""


def silent(share: float, text: str) -> None:
    """Report nothing."""


class Kill(Exception):  # noqa: N818 - it stands for a SIGKILL
    """Ends training at a step, where a kill might."""


def train(method: str, task: GymTask = WHOLE, path: Path | None = None, kill_at: int | None = None) -> Trained:
    calls = 0

    def on_progress(share: float, text: str) -> None:
        nonlocal calls
        calls += 1
        if calls == kill_at:
            raise Kill

    make_worlds, chosen = maker(task), METHOD[method]
    problem = TrainingProblem(
        task=task,
        make_worlds=make_worlds,
        method=chosen,
        graph=training_graph(task, chosen, manual_graph(task), make_worlds, 0),
        settings=TINY,
        evaluation=EvaluationSettings(every=60, episodes=1, final_episodes=1),
        env_steps=120,
        seed=0,
        on_evaluation=lambda evaluation, counts: None,
        on_progress=on_progress,
        checkpoints=Checkpoints(path, every=20) if path else None,
    )
    return LEARNERS[chosen.learner].train(problem)


def weights(trained: Trained) -> list[list[float]]:
    return [w.flatten().tolist() for actor in trained.policy.actors for w in actor]  # type: ignore[attr-defined]


@pytest.mark.parametrize("method", ["cmSAC", "mSAC"])
def test_a_killed_training_goes_on_to_the_same_weights(method: str, tmp_path: Path) -> None:
    whole = train(method)
    assert whole.counts.env_steps == 120
    assert sum(whole.counts.updates.values()) > 0
    path = tmp_path / "checkpoint.safetensors"
    with pytest.raises(Kill):
        train(method, path=path, kill_at=35)
    assert path.exists()
    resumed = train(method, path=path)
    assert weights(resumed) == weights(whole)
    assert resumed.counts.transitions.tolist() == whole.counts.transitions.tolist()


def test_without_snapshots_no_checkpoint_is_kept_and_training_is_the_same(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.safetensors"
    forgetful = dataclasses.replace(WHOLE, snapshot=None, restore=None, exact_restore=False)
    assert weights(train("mSAC", forgetful, path)) == weights(train("mSAC"))
    assert not path.exists()


def test_an_action_without_causes_is_never_set_and_a_saved_policy_acts_alike(tmp_path: Path) -> None:
    policy = train("cmSAC").policy
    policy.save(tmp_path)
    again = load_policy(tmp_path)
    seen = {"state": np.array([[-0.5, 0.01], [0.1, 0.06]], np.float32), "stage": np.array([0, 1])}
    actions = policy.predict(seen)[0]
    assert (actions[:, 1] == 0).all()
    assert (actions[:, 0] != 0).all()
    assert again.predict(seen)[0].tolist() == actions.tolist()


@pytest.mark.parametrize("learner", [
    lambda scale: StagedSAC(LINE, METHOD["mSAC"], None, scale, TINY, 0),
    lambda scale: StagedPPO(LINE, METHOD["mPPO"], None, scale, PPOSettings(net_arch=(8,), n_envs=3, n_steps=6), 0),
], ids=["SAC", "PPO"])  # fmt: skip
def test_an_agents_episode_ends_where_its_world_does(learner: Any) -> None:
    env = StageTaskVectorEnv(maker(LINE)(3))
    agents = learner(ObservationScale.of(env.single_observation_space, LINE))
    obs, _ = env.reset(seed=0)
    actions = np.array([[-1.0, 0.0], [0.2, 0.0], [1.0, 0.0]])  # the first falls off, the last is soon in stage 2
    for _ in range(2):
        next_obs, _, terminated, truncated, infos = env.step(actions)
        agents.remember(obs, actions, infos, terminated | truncated)
        obs = next_obs
    done = agents.agents[0].buffer.data.done[:6] if hasattr(agents.agents[0], "buffer") else agents.rollout.steps.done
    assert done.reshape(2, 3).bool().tolist() == [[True, False, False], [True, False, True]]


class Driver:
    """The expert's rule, from what an agent observes."""

    def predict(self, obs: dict[str, Any], *state: Any, deterministic: bool = True) -> tuple[Any, None]:
        push = np.where(obs["state"][..., 1] >= 0, 1.0, -1.0)
        return np.stack([push, np.zeros_like(push)], -1).astype(np.float32), None

    def save(self, folder: Path) -> None:
        """There is nothing to save."""


def test_an_evaluation_counts_success_and_an_end_without_it_and_nothing_is_held() -> None:
    solved = summary(0, Player(maker(CAR)(2), 0).play(Driver(), range(3), True), (), None)
    assert (solved.success_deterministic, solved.mean_final_stage, solved.held_rate) == (1.0, 3.0, None)
    fallen = summary(0, Player(maker(LINE)(2), 0).play(Leftward(), range(3), True), (), None)
    assert (fallen.success_deterministic, fallen.mean_final_stage, fallen.mean_length) == (0.0, 1.0, 1.0)


class Leftward(Driver):
    def predict(self, obs: dict[str, Any], *state: Any, deterministic: bool = True) -> tuple[Any, None]:
        return np.tile(np.array([-1.0, 0.0], np.float32), (len(obs["state"]), 1)), None


def found_by(name: str, task: GymTask, **own: Any) -> CausalGraph:
    shared = {"training_count": 400} if name == "kl" else {}
    settings = DISCOVERERS[name].configure("quick", shared, own)
    return discover(task, maker(task), settings, 0, silent)


DRIVE_ALONE = [[[True, True], [False, False]]] * 2


@pytest.mark.parametrize(("name", "own"), [("kl", {"max_epochs": 60}), ("paired", {"max_actions": 400})])
def test_discovery_finds_that_driving_is_the_only_cause(name: str, own: dict[str, Any]) -> None:
    graph = found_by(name, CAR, **own)
    assert [stage.matrix.tolist() for stage in graph.stages] == DRIVE_ALONE
    assert all(stage.testable is None or stage.testable.all() for stage in graph.stages)


def test_without_snapshots_the_papers_method_works_all_the_same() -> None:
    graph = found_by("kl", CAR_THAT_FORGETS, max_epochs=60)
    assert [stage.matrix.tolist() for stage in graph.stages] == DRIVE_ALONE
    assert graph.env_steps > found_by("kl", CAR, max_epochs=1).env_steps  # stage 2 is driven to every time


def test_several_processes_find_the_same_at_the_same_price(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(CAR_FILE.parent)  # where other processes find the task
    assert pickle.loads(pickle.dumps(CAR)).name == CAR.name
    settings = DISCOVERERS["kl"].configure("quick", {"training_count": 40, "n_placebos": 2}, {"max_epochs": 1})
    alone = discover(CAR, maker(CAR), settings, 0, silent)
    monkeypatch.setattr("causalbench.core.discovery.samples.pool.PARALLEL_FROM", 1)
    together = discover(CAR, maker(CAR), settings, 0, silent, cores=2)
    assert together.hash == alone.hash
    assert together.env_steps == alone.env_steps


def test_the_oracle_knows_it_exactly() -> None:
    truth = consult_oracle(CAR, maker(CAR), 60, 0, silent)
    assert [stage.matrix.tolist() for stage in oracle_graph(CAR, truth, 0).stages] == DRIVE_ALONE
    assert all(stage.exact_restore and not stage.floor.any() for stage in truth)


@pytest.mark.parametrize(("ask", "purpose"), [
    (lambda task: found_by("paired", task), "trying other actions in the same state needs the capability 'restore'"),
    (lambda task: found_by("sufficient", task), "trying other actions .* 'restore'"),
    (lambda task: consult_oracle(task, maker(task), 5, 0, silent), "trying other actions .* 'restore'"),
    (lambda task: solved_starts(maker(task)(1), 1, {}), "solving a stage on some of its actions .* 'expert'"),
], ids=["paired", "sufficient", "oracle", "expert"])  # fmt: skip
def test_what_needs_more_than_the_environment_can_do_says_so(ask: Any, purpose: str) -> None:
    with pytest.raises(UserError, match=f"^{purpose}, and gymnasium does not have it in task 'mountain_car'$"):
        ask(dataclasses.replace(CAR_THAT_FORGETS, expert=None))


def test_the_expert_solves_stages_by_driving_and_not_by_honking() -> None:
    worlds = maker(CAR)(2)
    assert solved_starts(worlds, 1, {1: ("drive",), 2: ("drive",)}, 4).all()
    assert not solved_starts(worlds, 2, {1: ("horn",), 2: ("horn",)}, 4).all()
