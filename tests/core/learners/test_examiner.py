"""When training ends before its budget, and on which starts it is judged."""

import dataclasses

import pytest
from training import METHOD, train

from causalbench.core.kinematic import make
from causalbench.core.learners import evaluation, examiner
from causalbench.core.learners.ppo.settings import PPOSettings
from causalbench.core.learners.records import Episode, Evaluation
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.learners.sb3.settings import SB3PPOSettings
from causalbench.core.learners.settings import FIRST_START, EvaluationSettings
from causalbench.core.tasks.pure_manipulation import TASK

LOOKS = EvaluationSettings(every=40, episodes=1, final_episodes=3, stop_after=2)
SETTINGS = {
    "mSAC": SACSettings(net_arch=(8, 8), batch_size=16, learning_starts=40),
    "mPPO": PPOSettings(net_arch=(8, 8), batch_size=16, n_steps=64),
    "PPO": SB3PPOSettings(net_arch=(8, 8), batch_size=16, n_steps=64),
}


@pytest.fixture
def outcomes(monkeypatch):
    """The successes that evaluations come out with, one after another; the last one for ever."""
    given = []

    def evaluate(policy, env, episodes, env_steps, first_start):
        success = given.pop(0) if len(given) > 1 else given[0]
        return Evaluation(env_steps, episodes, success, 0.0, None, 0.0, 1.0, 1.0, {})

    monkeypatch.setattr(examiner, "evaluate", evaluate)
    return given


def _seen(name, looks=LOOKS):
    seen = []
    _, counts = train(
        TASK, make, METHOD[name], None, SETTINGS[name], looks, 240, on_evaluation=lambda found, _: seen.append(found)
    )
    return counts.env_steps, [(found.env_steps, found.episodes, found.success_deterministic) for found in seen]


@pytest.mark.parametrize("name", SETTINGS)
def test_training_ends_after_evaluations_in_a_row_without_a_failure(name, outcomes):
    outcomes += [1.0, 0.9, 1.0, 1.0, 0.75]  # the last one is the final evaluation, which says what it says
    assert _seen(name) == (160, [(40, 1, 1.0), (80, 1, 0.9), (120, 1, 1.0), (160, 3, 0.75)])


@pytest.mark.parametrize("name", SETTINGS)
def test_without_such_a_row_or_such_a_setting_it_goes_on_to_the_budget(name, outcomes):
    outcomes += [1.0, 0.9] * 4
    assert _seen(name)[0] == 240
    outcomes[:] = [1.0]
    assert _seen(name, dataclasses.replace(LOOKS, stop_after=0))[0] == 240


def test_starts_are_those_of_the_settings(monkeypatch):
    seeds = []

    def play(policy, env, first_start, number, deterministic):
        seeds.append(first_start + number)
        return Episode(number, deterministic, False, None, 4, (1,), 1, dict.fromkeys(env.reward_names, 0.0))

    monkeypatch.setattr(evaluation, "_play", play)
    for looks in (EvaluationSettings(every=100, final_episodes=2), EvaluationSettings(100, 1, 2, first_start=7)):
        train(TASK, make, METHOD["mSAC"], None, SETTINGS["mSAC"], looks, 1)
    assert seeds == [*[FIRST_START, FIRST_START + 1] * 2, *[7, 8] * 2]
    assert FIRST_START != 1_000_000  # the first start of every search so far
