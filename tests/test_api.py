"""`causalbench.train` and `causalbench.discover`: what cannot be honoured is refused by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import pytest

import causalbench
from causalbench import DiscoverySettings, EvaluationSettings, PPOSettings, SACSettings
from causalbench.core.discovery.graph import manual_graph
from causalbench.core.discovery.methods.kl.settings import KLSettings
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.errors import InvalidGraphError, UserError

WRAPPERS: dict[str, Callable[[gym.Env[Any, Any]], gym.Env[Any, Any]]] = {
    "TimeLimit": lambda env: gym.wrappers.TimeLimit(env, 20),
    "TransformReward": lambda env: gym.wrappers.TransformReward(env, lambda reward: 100 * reward),
    "StickyAction": lambda env: gym.wrappers.StickyAction(env, 0.9),
    "TransformAction": lambda env: gym.wrappers.TransformAction(env, lambda action: 0 * action, None),
}


@pytest.mark.parametrize("call", [causalbench.train, causalbench.discover])
@pytest.mark.parametrize("name", WRAPPERS)
def test_a_wrapper_that_its_own_worlds_would_not_have_is_refused(name: str, call: Callable[..., Any]) -> None:
    env = WRAPPERS[name](gym.make("causalbench:causalbench/PureManipulation-v0"))
    with pytest.raises(UserError, match=f"^{name}: the worlds of train and discover are made anew"):
        call(env)
    env.close()


@pytest.mark.parametrize(
    ("method", "arguments", "message"),
    [
        ("mSAC", {"settings": SACSettings(gamma=2.0)}, "SACSettings.gamma: should be less than or equal to 1, got 2"),
        ("mSAC", {"settings": SACSettings(n_envs=0)}, "SACSettings.n_envs: should be greater than 0, got 0"),
        ("mSAC", {"settings": SACSettings(net_arch=(8, 0))}, "SACSettings.net_arch: should be greater than 0, got"),
        ("mPPO", {"settings": PPOSettings(n_steps=1.5)}, "PPOSettings.n_steps: should be a valid integer, got 1.5"),
        ("mSAC", {"evaluation": EvaluationSettings(every=0)}, "EvaluationSettings.every: should be greater than 0"),
        ("mSAC", {"evaluation": None}, "expected EvaluationSettings, got NoneType"),
        ("mSAC", {"env_steps": 0}, "env_steps: should be greater than 0, got 0"),
        ("mSAC", {"env_steps": 100.5}, "env_steps: should be a valid integer, got 100.5"),
        ("mSAC", {"seed": -1}, "seed: should be greater than or equal to 0, got -1"),
        ("mSAC", {"seed": True}, "seed: should be a valid integer, got True"),
    ],
)
def test_what_training_cannot_honour_is_refused_by_name(method: str, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError) as refused:
        causalbench.train(causalbench.make_env(), method, **arguments)
    assert str(refused.value).startswith(message)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"settings": DiscoverySettings(training_count=-1)},
            "DiscoverySettings.training_count: should be greater than",
        ),
        ({"settings": DiscoverySettings(options=KLSettings(max_epochs=0))}, "KLSettings.max_epochs: should be greater"),
        ({"settings": "kl"}, "expected DiscoverySettings, got str"),
        ({"seed": 1.5}, "seed: should be a valid integer, got 1.5"),
    ],
)
def test_what_discovery_cannot_honour_is_refused_by_name(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError) as refused:
        causalbench.discover(causalbench.make_env(), **arguments)
    assert str(refused.value).startswith(message)


@pytest.mark.parametrize(
    ("method", "graph", "message"),
    [
        ("mSAC", manual_graph(TASK), "graph: method 'mSAC' uses none, and this one would be ignored"),
        ("cmmSAC", manual_graph(TASK), "graph: method 'cmmSAC' uses the one that a human named, and this"),
        ("cmSAC", "graph.json", "graph: expected what causalbench.discover or causalbench.load_graph returns, got str"),
    ],
)
def test_a_graph_that_would_be_ignored_is_refused(method: str, graph: Any, message: str) -> None:
    with pytest.raises(InvalidGraphError) as refused:
        causalbench.train(causalbench.make_env(), method, graph)
    assert str(refused.value).startswith(message)
