"""Training as a whole: routing, determinism, counts, policies."""

import copy
import dataclasses
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
import torch
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import DummyVecEnv
from training import METHOD, train

from causalbench.core.discovery.graph import manual_graph
from causalbench.core.kinematic import make
from causalbench.core.learners.counting import Counter
from causalbench.core.learners.evaluation import Player, summary
from causalbench.core.learners.methods import PAPER
from causalbench.core.learners.policy import ObservationScale, StagedPolicy, load_policy
from causalbench.core.learners.ppo.settings import PPOSettings
from causalbench.core.learners.ppo.staged import StagedPPO
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.learners.sac.staged import StagedSAC
from causalbench.core.learners.settings import EvaluationSettings
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.scene_worlds import SceneWorlds, make_scene_worlds
from causalbench.core.staged.vector_env import StageTaskVectorEnv
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.core.tasks.pure_manipulation_data import C
from causalbench.core.world.batch import make_batch
from causalbench.errors import DivergedError, InvalidGraphError, UserError

TINY = SACSettings(net_arch=(8, 8), batch_size=16, learning_starts=40, n_envs=4)
TINY_PPO = PPOSettings(net_arch=(8, 8), batch_size=16, n_steps=64, n_envs=4)
ONE_LOOK = EvaluationSettings(every=200, episodes=1, final_episodes=2)


def _train(name, seed=0, env_steps=400, settings=None, make_scene=make):
    seen = []
    graph = manual_graph(TASK) if METHOD[name].matrix == "discovered" else None
    policy, counts = train(
        TASK,
        make_scene,
        METHOD[name],
        graph,
        settings or {"SAC": TINY, "PPO": TINY_PPO}[METHOD[name].learner],
        ONE_LOOK,
        env_steps,
        seed,
        lambda evaluation, counts: seen.append(evaluation),
    )
    return policy, counts, seen


@pytest.mark.parametrize("name", [method.name for method in PAPER])
def test_every_method_trains_and_is_a_function_of_its_seed(name):
    (policy, counts, seen), (again, counts_again, seen_again), (other, _, _) = (_train(name, s) for s in (0, 0, 1))
    assert seen == seen_again
    assert dataclasses.asdict(counts).keys() == dataclasses.asdict(counts_again).keys()
    np.testing.assert_array_equal(counts.transitions, counts_again.transitions)
    assert counts.env_steps == counts.transitions.sum() == 400
    assert counts.updates[1] > 0
    assert [e.env_steps for e in seen] == [200, 400]
    weights, same, different = (torch.cat([w.flatten() for a in p.actors for w in a]) for p in (policy, again, other))
    assert torch.equal(weights, same)
    assert not torch.equal(weights, different)


@pytest.mark.parametrize("name", ["cmmSAC", "cSAC", "cmmPPO"])
def test_both_engines_train_the_same_policy(name):
    """In whole trainings, where a difference in rounding changes the next actions, too."""
    learner = METHOD[name].learner
    settings = {"SAC": TINY, "PPO": TINY_PPO}[learner]
    (fused, _, _), (autograd, counts, _) = (
        _train(name, settings=dataclasses.replace(settings, engine=engine)) for engine in ("fused", "autograd")
    )
    assert counts.updates[1] > 10
    for one, other in zip(fused.actors, autograd.actors, strict=True):
        for w, v in zip(one, other, strict=True):
            torch.testing.assert_close(w, v, atol=1e-3, rtol=1e-3)


def test_training_leaves_global_random_states_alone():
    np_state, torch_state = np.random.get_state()[1].copy(), torch.get_rng_state()  # noqa: NPY002 - it is the subject
    _train("cmSAC")
    np.testing.assert_array_equal(np.random.get_state()[1], np_state)  # noqa: NPY002
    assert torch.equal(torch.get_rng_state(), torch_state)


def test_a_discovered_graph_is_needed_and_checked():
    graph = manual_graph(TASK)
    with pytest.raises(InvalidGraphError, match="needs a discovered causal graph"):
        train(TASK, make, METHOD["cmSAC"], None, TINY, ONE_LOOK, 10)
    wrong = dataclasses.replace(graph, task_version=7)
    with pytest.raises(InvalidGraphError, match="not pure_manipulation v0"):
        train(TASK, make, METHOD["cmSAC"], wrong, TINY, ONE_LOOK, 10)


@pytest.mark.parametrize(("budget", "taken"), [(10, 12), (12, 12)])
def test_a_budget_is_rounded_up_to_whole_steps_of_all_worlds_and_counted_exactly(budget, taken):
    _, counts, seen = _train("mSAC", env_steps=budget)
    assert counts.env_steps == counts.transitions.sum() == taken
    assert [e.env_steps for e in seen] == [taken]


def test_a_stage_that_was_never_reached_is_reported_and_not_trained(caplog):
    caplog.set_level("INFO", "causalbench")
    settings = dataclasses.replace(TINY, learning_starts=0)  # even then there is nothing to train on
    _, counts, _ = _train("mSAC", settings=settings)
    unreached = [stage for stage, episodes in counts.reached.items() if episodes == 0]
    assert 4 in unreached
    assert [counts.updates[stage] for stage in unreached] == [0] * len(unreached)
    assert f"never reached, so not trained: stages {unreached}" in caplog.text


@pytest.mark.parametrize("name", ["cmmSAC", "cSAC"])
def test_exploding_losses_name_step_and_stage(name):
    settings = dataclasses.replace(TINY, learning_rate=1e30)
    with pytest.raises(DivergedError, match=r"env step \d+, stage 1: .* after \d+ updates$"):
        _train(name, settings=settings)


def test_exploding_losses_of_ppo_name_step_and_stage():
    settings = dataclasses.replace(TINY_PPO, learning_rate=1e30)
    with pytest.raises(DivergedError, match=r"env step \d+, stage 1: loss is not finite after \d+ updates"):
        _train("mPPO", settings=settings)


def _learner(name="cmmSAC", **changes):
    settings = dataclasses.replace(TINY, **changes)
    env = StageTaskVectorEnv(SceneWorlds(TASK, make_batch(make, settings.n_envs)))
    scale = ObservationScale.of(env.single_observation_space, TASK)
    return StagedSAC(TASK, METHOD[name], manual_graph(TASK), scale, settings, 0), env


def test_steps_go_to_the_agent_of_the_stage_they_began_in():
    learner, env = _learner(n_envs=8)
    obs, _ = env.reset(seed=0)
    stages = np.zeros(5, dtype=int)
    done = np.zeros(5)
    for _ in range(60):
        actions = env.worlds.expert()
        next_obs, _, terminated, truncated, infos = env.step(actions)
        learner.remember(obs, actions, infos, terminated | truncated)
        np.add.at(stages, infos["stage"], 1)
        left = (infos["next_stage"] != infos["stage"]) | infos["is_success"]
        np.add.at(done, infos["stage"], left)
        obs = next_obs
    assert [agent.buffer.size for agent in learner.agents] == stages[1:].tolist()
    assert (stages[1:] > 0).all()
    assert [float(agent.buffer.data.done.sum()) for agent in learner.agents] == done[1:].tolist()
    # The expert's success pays the grasp, the bonus and nothing else; stage 4's only critic sees their sum.
    assert learner.agents[3].buffer.data.rewards.max() == 7.0


def test_actions_that_are_not_causal_are_executed_as_zero():
    learner, _ = _learner()
    n = 40
    low, high = TASK.state_bounds(make().spec.workspace)
    rng = np.random.default_rng(0)
    state = rng.uniform(low, high, (n, 15)).astype(np.float32)
    obs = {
        "state": state,
        "features": TASK.features_of(state),
        "gripper": rng.uniform(0, 0.1, (n, 1)).astype(np.float32),
        "stage": np.arange(n) % 4,
    }
    ppo = StagedPPO(TASK, METHOD["cmmPPO"], manual_graph(TASK), learner.scale, TINY_PPO, 0)
    for actions in (learner.act(obs), learner.policy.predict(obs)[0], ppo.act(obs), ppo.policy.predict(obs)[0]):
        for stage, own in ((1, "armx army armz grip"), (2, "armrx armry armrz grip"), (3, "armz grip"), (4, "grip")):
            moved = (actions[obs["stage"] == stage - 1] != 0).any(0)
            assert [a for a, m in zip(TASK.actions, moved, strict=True) if m] == own.split()


def test_a_stage_trains_only_on_new_samples_of_its_own():
    learner, env = _learner(n_envs=1, learning_starts=20, train_every=8, updates_per_sample=0.5)
    obs, _ = env.reset(seed=0)
    history = []
    for _ in range(40):
        actions = np.zeros((1, 7))  # stays in stage 1
        next_obs, _, terminated, truncated, infos = env.step(actions)
        learner.remember(obs, actions, infos, terminated | truncated)
        learner.train()
        obs = next_obs
        history.append([agent.updates for agent in learner.agents])
    stage_1 = [updates[0] for updates in history]
    # The 19 samples before `learning_starts` do not count as new: 8 new ones are there at step 27 and 35.
    assert stage_1 == [0] * 26 + [4] * 8 + [8] * 6
    assert all(updates[1:] == [0, 0, 0] for updates in history)


def test_ppo_trains_at_the_end_of_an_epoch_and_goes_on_from_its_state():
    """Two learners, one made anew from the other's state in mid-epoch, end with the same weights."""
    env = StageTaskVectorEnv(SceneWorlds(TASK, make_batch(make, TINY_PPO.n_envs)))
    scale = ObservationScale.of(env.single_observation_space, TASK)
    first, second = (StagedPPO(TASK, METHOD["cmmPPO"], manual_graph(TASK), scale, TINY_PPO, s) for s in (0, 1))
    obs, _ = env.reset(seed=0)
    history = []
    learners = [first]
    for step in range(40):
        actions = [learner.act(obs) for learner in learners]
        np.testing.assert_array_equal(actions[0], actions[-1])
        next_obs, _, terminated, truncated, infos = env.step(actions[0].clip(-1, 1))
        for learner in learners:
            learner.remember(obs, actions[0], infos, terminated | truncated)
            learner.train()
        obs = next_obs
        history.append(first.updates()[1])
        if step == 20:
            second.load_state({name: copy.deepcopy(value) for name, value in first.state().items()})
            learners.append(second)
    # 64 samples are 16 steps of 4 worlds, 10 passes of 4 batches.
    assert history[:32] == [0] * 15 + [40] * 16 + [80]
    assert first.updates() == second.updates()
    for one, two in zip(first.policy.actors, second.policy.actors, strict=True):
        assert all(torch.equal(w, v) for w, v in zip(one, two, strict=True))


def _infos(stage, next_stage, success=False):
    stage, next_stage = np.array([stage]), np.array([next_stage])
    return {
        "stage": stage,
        "next_stage": next_stage,
        "reversal": next_stage < stage,
        "is_success": np.array([success]),
    }


def test_counter_tells_long_reversals_from_chatter():
    counter = Counter(4, 1)
    walk = [1, 2, 1, 2, 1, 1, 1, 1, 2, 3, 4]  # one chatter, then a reversal of four steps
    for before, after in pairwise(walk):
        counter.add(_infos(before, after), np.array([False]))
    counter.add(_infos(4, 4, success=True), np.array([True]))
    counter.add(_infos(1, 2), np.array([True]))  # another episode
    counts = counter.counts
    assert (counts.env_steps, counts.episodes, counts.successes) == (12, 2, 1)
    assert (counts.reversals, counts.long_reversals) == (2, 1)
    assert counts.reached == {1: 2, 2: 2, 3: 1, 4: 1}
    assert counts.transitions[1, 2] == 4
    assert counts.transitions[2, 1] == 2
    assert counts.transitions[4, 4] == 1


class _Expert(StagedPolicy):
    """The scripted expert behind the policy interface."""

    def __init__(self, worlds):
        self.worlds = worlds

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return self.worlds.expert().astype(np.float32), state


@pytest.mark.parametrize("n", [1, 3, 8])
def test_evaluation_of_the_expert_is_perfect_however_many_worlds_it_has(make_scene, n):
    worlds, one = (make_scene_worlds(TASK, make_scene, number) for number in (n, 1))
    played = [Player(worlds, 50).play(_Expert(worlds), range(5), deterministic) for deterministic in (True, False)]
    found = summary(7, *played, 1.0)
    assert played[0] == Player(one, 50).play(_Expert(one), range(5), True)
    assert (found.env_steps, found.success_deterministic, found.success_sampled, found.held_rate) == (7, 1.0, 1.0, 1.0)
    assert found.mean_final_stage == 5.0
    assert found.term_returns["r_gripper"] == 5.0
    assert found.term_returns["r_collision_arm"] == 0.0


class _Idle(_Expert):
    """Does nothing, and so never succeeds."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((self.worlds.n, 7), dtype=np.float32), state


def test_without_success_there_is_no_held_rate():
    worlds = make_scene_worlds(TASK, make, 1)
    found = summary(0, Player(worlds, 0).play(_Idle(worlds), range(2), True), (), None)
    assert (found.success_deterministic, found.held_rate, found.mean_final_stage) == (0.0, None, 1.0)
    assert found.mean_length == TASK.horizon


@pytest.mark.parametrize("name", ["cmmSAC", "cmmPPO"])
def test_policy_round_trip_and_sb3s_own_evaluation(name, tmp_path):
    policy, _, _ = _train(name)
    policy.save(tmp_path / "policy")
    loaded = load_policy(tmp_path / "policy")
    env = StageTaskEnv(SceneWorlds(TASK, make()))
    obs, _ = env.reset(seed=3)
    for _ in range(5):
        action, state = loaded.predict(obs)
        np.testing.assert_array_equal(action, policy.predict(obs)[0])
        assert state is None
        assert action.shape == (7,)
        obs, *_ = env.step(action)
    vec = DummyVecEnv([lambda: StageTaskEnv(SceneWorlds(TASK, make()))])
    vec.seed(0)
    mean, _ = evaluate_policy(loaded, vec, n_eval_episodes=2, warn=False)
    assert np.isfinite(mean)
    code = (
        "from causalbench.core.learners.policy import load_policy\n"
        f"print(load_policy({str(tmp_path / 'policy')!r}).n_actions)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "7"


def test_a_folder_without_a_policy_is_named(tmp_path):
    with pytest.raises(UserError, match="no trained policy here"):
        load_policy(tmp_path)


@pytest.mark.parametrize("learner", ["SAC", "PPO"])
def test_full_stages_make_a_method_with_a_graph_one_without(learner):
    """All stages: the same weights as the method without; none: as the method with; one: its actors differ there."""
    tiny = {"SAC": TINY, "PPO": TINY_PPO}[learner]

    def actors(name, full_stages):
        policy, _, _ = _train(name, settings=dataclasses.replace(tiny, full_stages=full_stages))
        return policy

    every, plain = actors(f"cmm{learner}", (1, 2, 3, 4)), actors(f"m{learner}", ())
    for ours, theirs in zip(every.actors, plain.actors, strict=True):
        for one, other in zip(ours, theirs, strict=True):
            assert torch.equal(one, other)
    names = [[TASK.actions[k] for k in own] for own in actors(f"cmm{learner}", (1, 2, 3)).actions]
    assert names == [[*TASK.actions]] * 3 + [["grip"]]


@pytest.mark.parametrize(
    ("name", "full_stages", "message"),
    [
        ("mSAC", (1,), "`full_stages`: method 'mSAC' has all actions in every stage"),
        ("cmmPPO", (5,), r"`full_stages`: \[5\] are none of the 4 stages of 'pure_manipulation'"),
    ],
)
def test_full_stages_that_mean_nothing_are_refused(name, full_stages, message):
    tiny = TINY if name == "mSAC" else TINY_PPO
    with pytest.raises(UserError, match=message):
        _train(name, settings=dataclasses.replace(tiny, full_stages=full_stages))


def test_a_staged_learner_may_get_each_bonus_once_an_episode(monkeypatch):
    """What an agent remembers: no bonus for a stage that the episode has been in, wherever there is one without."""

    def back_and_forth(self, obs):
        actions = np.zeros((len(obs["stage"]), 7))
        actions[:, :3] = 10 * (obs["state"][:, :3] + [0.0, 0.0, C.hover] - obs["state"][:, 3:6])
        actions[obs["stage"] > 0, :2] = 1.0
        return actions.clip(-1.0, 1.0)

    monkeypatch.setattr(StagedPPO, "act", back_and_forth)
    kept = {}
    for bonus in ("every_entry", "first_entry"):
        rewards = kept[bonus] = []
        remember = StagedPPO.remember

        def watched(self, obs, actions, infos, over, rewards=rewards, remember=remember):
            rewards.append((infos["stage"], infos["next_stage"], infos["vector_reward"], over))
            remember(self, obs, actions, infos, over)

        monkeypatch.setattr(StagedPPO, "remember", watched)
        _train("mPPO", settings=dataclasses.replace(TINY_PPO, bonus=bonus, n_steps=10_000), env_steps=400)
        monkeypatch.setattr(StagedPPO, "remember", remember)
    column, again = TASK.term_names.index("r_success"), 0
    reached = np.zeros(4, dtype=int)
    for (stage, next_stage, every, over), (*_, first, _) in zip(*kept.values(), strict=True):
        reached = np.maximum(reached, stage)
        repeated = (next_stage > stage) & (next_stage <= reached)
        expected = every.copy()
        expected[repeated, column] = 0.0
        np.testing.assert_array_equal(first, expected)
        again += repeated.sum()
        reached = np.where(over, 0, np.maximum(reached, next_stage))
    assert again > 20


@pytest.mark.long
def test_cmsac_learns_the_task_on_kinematic():
    """About 90% after 12,000 steps; half of that is far beyond what an untrained policy can do."""
    settings = SACSettings(n_envs=4)
    seen = []
    look = EvaluationSettings(every=14_000, episodes=1, final_episodes=20)
    train(
        TASK,
        make,
        METHOD["cmmSAC"],
        None,
        settings,
        look,
        14_000,
        0,
        lambda evaluation, counts: seen.append(evaluation),
    )
    assert seen[-1].success_sampled >= 0.8
    assert seen[-1].success_deterministic >= 0.5
    assert seen[-1].held_rate == 1.0
