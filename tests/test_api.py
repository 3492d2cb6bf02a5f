"""`causalbench.train` and `causalbench.discover`: what cannot be honoured is refused by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import pytest

import causalbench
from causalbench.errors import UserError

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
