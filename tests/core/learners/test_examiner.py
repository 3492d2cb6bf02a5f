"""When training ends before its budget, and on which starts it is judged."""

import dataclasses
import functools
import json
from contextlib import closing

import numpy as np
import pytest
from scenes import worlds_of
from training import METHOD, train

from causalbench.core.kinematic import make
from causalbench.core.learners.evaluation import Player
from causalbench.core.learners.examiner import Examiner
from causalbench.core.learners.ppo.settings import PPOSettings
from causalbench.core.learners.records import Episode, TrainingCounts
from causalbench.core.learners.registry import TrainingProblem
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.learners.sb3.settings import SB3PPOSettings
from causalbench.core.learners.settings import FIRST_START, EvaluationSettings
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.core.world.batch import SceneList

LOOKS = EvaluationSettings(every=40, episodes=1, final_episodes=3, stop_after=2)
SETTINGS = {
    "mSAC": SACSettings(net_arch=(8, 8), batch_size=16, learning_starts=40),
    "mPPO": PPOSettings(net_arch=(8, 8), batch_size=16, n_steps=32),
    "PPO": SB3PPOSettings(net_arch=(8, 8), batch_size=16, n_steps=32),
}


@pytest.fixture
def outcomes(monkeypatch):
    """How deterministic episodes that are played together end, one time after another; the last for ever."""
    given = []

    def play(player, policy, numbers, deterministic):
        success = deterministic and (given.pop(0) if len(given) > 1 else given[0])
        return tuple(_episode(number, success) for number in numbers)

    monkeypatch.setattr(Player, "play", play)
    return given


def _episode(number, success=False):
    return Episode(number, True, success, None, 4, (1,), 1, {"r_gripper": 0.0})


def _seen(name, looks=LOOKS):
    seen = []
    _, counts = train(
        TASK, make, METHOD[name], None, SETTINGS[name], looks, 240, on_evaluation=lambda found, _: seen.append(found)
    )
    return counts.env_steps, [(found.env_steps, found.episodes, found.success_deterministic) for found in seen]


@pytest.mark.parametrize("name", SETTINGS)
def test_training_ends_after_evaluations_in_a_row_without_a_failure(name, outcomes):
    outcomes += [True, False, True, True, False]  # the last are the two more episodes of the final evaluation
    assert _seen(name) == (160, [(40, 1, 1.0), (80, 1, 0.0), (120, 1, 1.0), (160, 3, 1 / 3)])


@pytest.mark.parametrize("name", SETTINGS)
def test_without_such_a_row_or_such_a_setting_it_goes_on_to_the_budget(name, outcomes):
    outcomes += [True, False] * 4
    assert _seen(name)[0] == 240
    outcomes[:] = [True]
    assert _seen(name, dataclasses.replace(LOOKS, stop_after=0))[0] == 240


def test_starts_are_those_of_the_settings(monkeypatch):
    seeds = []

    def play(player, policy, numbers, deterministic):
        seeds.extend(player.first_start + number for number in numbers)
        return tuple(map(_episode, numbers))

    monkeypatch.setattr(Player, "play", play)
    for looks in (EvaluationSettings(every=100, final_episodes=2), EvaluationSettings(100, 1, 2, first_start=7)):
        train(TASK, make, METHOD["mSAC"], None, SETTINGS["mSAC"], looks, 1)
    assert seeds == [*[FIRST_START, FIRST_START + 1] * 2, *[7, 8] * 2]
    assert FIRST_START != 1_000_000  # the first start of every search so far


def _counts(env_steps, updates, episodes=0, successes=0):
    counts = TrainingCounts(np.zeros((5, 5), np.int64), env_steps, episodes, successes)
    counts.updates = {1: updates}
    return counts


@pytest.fixture
def problem():
    return TrainingProblem(
        TASK, worlds_of(TASK, make), METHOD["mSAC"], None, SETTINGS["mSAC"], LOOKS, 240, 0,
        lambda found, counts: None, lambda share, text: None,
    )  # fmt: skip


def test_no_episode_is_played_again_while_no_weight_changes_also_after_a_continuation(problem, monkeypatch):
    played = []

    def play(player, policy, numbers, deterministic):
        played.append((deterministic, [*numbers]))
        return tuple(map(_episode, numbers))

    monkeypatch.setattr(Player, "play", play)
    with closing(Examiner(problem)) as first, closing(Examiner(problem)) as second:
        for env_steps, updates in ((40, 0), (80, 0), (120, 5), (160, 5), (200, 6)):
            first.examine(None, _counts(env_steps, updates))
        second.load_state(json.loads(json.dumps(first.state())))
        second.examine(None, _counts(240, 6))
    again = [(True, [0]), (True, [0]), (True, [0]), (True, []), (True, [0])]  # without updates a learner may not count
    assert played == [*again, (True, [1, 2]), (False, [0, 1, 2])]
    assert second.evaluations[:-1] == first.evaluations


def test_success_of_sampled_actions_is_that_of_training_before_the_last_evaluation(problem, outcomes):
    outcomes += [False]
    with closing(Examiner(problem)) as examiner:
        training = ((40, 1, 0, 0), (80, 2, 4, 1), (120, 3, 6, 3), (240, 4, 9, 6))
        found = [examiner.examine(None, _counts(*counts)).success_sampled for counts in training]
    assert found == [None, 1 / 4, 1.0, 0.0]  # the last from episodes of its own


@pytest.mark.parametrize(("looks", "n"), [(LOOKS, 3), (EvaluationSettings(episodes=1, final_episodes=1), 1)])
def test_worlds_are_as_many_as_episodes_where_they_step_as_one_and_one_otherwise(problem, looks, n):
    problem = dataclasses.replace(problem, evaluation=looks)
    listed = dataclasses.replace(problem, make_worlds=functools.partial(_listed, TASK))
    for tried, expected in ((problem, n), (listed, 1)):
        with closing(Examiner(tried)) as examiner:
            assert examiner.worlds.n == expected


def _listed(task, n):
    return SceneWorlds(task, SceneList([make() for _ in range(n)]))
