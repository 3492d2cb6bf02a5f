"""What a staged task over a Gymnasium environment is: its data, and functions of what the environment gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.core.tasks.stage_task import StageTask
from causalbench.core.world.capabilities import Capability
from causalbench.errors import UserError

if TYPE_CHECKING:  # who registers a task does not import Gymnasium for it
    import gymnasium as gym

Array = NDArray[np.float64]


class Seen(NamedTuple):
    """What a Gymnasium environment returned after a step or a reset.

    `reward` is what the step paid, summed where an action is held; 0 after a reset and in what was seen before a step.
    """

    observation: Any
    info: Mapping[str, Any]
    reward: float = 0.0


@dataclass(frozen=True, kw_only=True)
class GymTask(StageTask):
    """A staged task over a Gymnasium environment whose action space is a Box about 0, one dimension per action.

    Actions are in [-1, 1] and scaled to that box, so that 0 means "not executed". The environment's own time limits are
    removed, and `horizon` is the clock. An environment that ends by itself ends the episode.

    - `environments`: name of a backend -> function that makes a new environment there; a suite's `options` of that
      backend are its keyword arguments. With `render_mode="rgb_array"` people see pictures of it;
    - `stage(seen)`: the paper's U(s), 1 to n_stages; memoryless, so it can go back;
    - `success(stage, now)`: the verdict, `stage` being U(s) before the step;
    - `rewards(before, stage, action, now, next_stage)`: (n_terms,); what terms that are not active in `stage` have
      there does not count;
    - `observe(seen)`: the state variables (n_state,), all that the rewards depend on;
    - `state_bounds`: (low, high), each (n_state,): where the state variables normally lie;
    - `snapshot(env)` and `restore(env, snapshot)`: all of an environment's state as bytes, and the way back, which
      returns what is seen there. `exact_restore` says that every later step is then the same to the bit;
    - `reset_into(env, rng, stage)`: puts the environment into a start that is meant to lie inside a stage, and returns
      what is seen there. Without it stages are entered by acting, see `core.staged.gym_starts`;
    - `expert(seen)`: the scripted action (n_actions,) that proves the task solvable;
    - `modules`: the imports that the environments need, so that a missing one is named and versions are recorded.

    All functions are pure but `reset_into` and `restore`, which change the environment. Raises `UserError` for parts
    that do not fit together.
    """

    environments: Mapping[str, Callable[..., gym.Env[Any, Any]]]
    stage: Callable[[Seen], int]
    success: Callable[[int, Seen], bool]
    rewards: Callable[[Seen, int, Array, Seen, int], Array]
    observe: Callable[[Seen], Array]
    state_bounds: tuple[Array, Array]
    snapshot: Callable[[gym.Env[Any, Any]], bytes] | None = None
    restore: Callable[[gym.Env[Any, Any], bytes], Seen] | None = None
    exact_restore: bool = False
    reset_into: Callable[[gym.Env[Any, Any], np.random.Generator, int], Seen] | None = None
    expert: Callable[[Seen], Array] | None = None
    modules: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.environments:
            raise UserError(f"task {self.name!r}: environments: expected a backend's name and a function, got none")
        if (self.snapshot is None) != (self.restore is None):
            raise UserError(f"task {self.name!r}: snapshot and restore: expected both or neither")
        if self.exact_restore and self.restore is None:
            raise UserError(f"task {self.name!r}: exact_restore: expected snapshot and restore with it")
        if self.paper_sensor:
            raise UserError(f"task {self.name!r}: paper_sensor: environments have none, all they show is their state")
        low, high = map(np.asarray, self.state_bounds)
        shape = (len(self.state_names),)
        if low.shape != shape or high.shape != shape or not (low < high).all():
            raise UserError(f"task {self.name!r}: state_bounds: expected low < high, each of shape {shape}")

    @property
    def capabilities(self) -> frozenset[Capability]:
        """What its worlds can do, pictures aside: those are the environment's."""
        offered = {
            Capability.RESTORE: self.restore is not None,
            Capability.EXACT_RESTORE: self.exact_restore,
            Capability.STAGE_RESET: self.reset_into is not None,
            Capability.EXPERT: self.expert is not None,
        }
        return frozenset(capability for capability, offers in offered.items() if offers)
