"""The examples, as they stand, with small budgets."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import gymnasium as gym
import pytest

import causalbench
from causalbench.core.discovery.methods.kl.settings import KLSettings
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.core.learners.sac.settings import SACSettings
from causalbench.core.learners.settings import EvaluationSettings
from causalbench.errors import UserError

EXAMPLES = Path(__file__).parents[1] / "examples"


def test_three_lines(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("three_lines", EXAMPLES / "three_lines.py")
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    example.ENV_STEPS, example.FOLDER = 60, str(tmp_path / "policy")
    example.DISCOVERY = DiscoverySettings(training_count=200, n_placebos=0, options=KLSettings(max_epochs=20))
    example.EVALUATION = EvaluationSettings(final_episodes=1)
    example.main()
    printed = capsys.readouterr().out
    assert "stage 4: " in printed
    assert "after 60 steps" in printed
    env = causalbench.make_env()
    action, _ = causalbench.load_policy(tmp_path / "policy").predict(env.reset(seed=0)[0])
    assert env.action_space.contains(action)


def test_a_policy_observes_what_its_environment_does() -> None:
    env = gym.make("causalbench/PureManipulation-v0", backend="kinematic", observe_gripper=False)
    trained = causalbench.train(env, "mSAC", env_steps=20, evaluation=EvaluationSettings(final_episodes=1))
    assert len(trained.policy.scale.low) == env.observation_space["state"].shape[0]
    assert [e.env_steps for e in trained.evaluations] == [trained.counts.env_steps] == [20]


@pytest.mark.parametrize(
    ("options", "method", "settings", "message"),
    [
        ({}, "mPPO", SACSettings(), "learner 'PPO' takes PPOSettings, got SACSettings"),
        ({"observe": "paper"}, "SAC", None, "'SAC' has no convolutions: it cannot have `observation: paper`"),
    ],
)
def test_settings_that_a_method_cannot_have_are_refused(
    options: dict, method: str, settings: object, message: str
) -> None:
    env = causalbench.make_env(**options)
    with pytest.raises(UserError, match=message):
        causalbench.train(env, method, env_steps=10, settings=settings)


def test_an_environment_of_another_kind_is_refused() -> None:
    with pytest.raises(UserError, match="make_env"):
        causalbench.discover(gym.make("CartPole-v1"))
