"""One number a step from a task's reward vector, for learners that climb one: what a fall back costs is what matters.

The paper's sum pays for falling back: progress terms count in their own stage only, so leaving a stage is free and
coming back is paid, with a bonus on top. See `Shaped` for a sum under which nothing is gained by it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from causalbench.core.learners.settings import ScalarName
from causalbench.core.tasks.stage_task import StageTask
from causalbench.errors import UserError
from causalbench.pages import page

if TYPE_CHECKING:
    from causalbench.core.staged.observation import Observation

Array = NDArray[np.float64]

Scalar = Callable[["Observation", Mapping[str, Any], NDArray[np.bool_]], Array]
"""(what was observed before the step, its `infos`, whose episode ended) of n worlds to n rewards."""


def make_scalar(name: ScalarName, task: StageTask, n: int, gamma: float) -> Scalar:
    """A scalar of `task` for `n` worlds that step together and a learner that discounts by `gamma`.

    Raises `UserError` for "shaped" where the task has several stages and no potential.
    """
    if name == "first_entry":
        first = FirstEntry(task, n)
        return lambda obs, infos, over: first(infos, over).sum(1)
    if name == "paper" or (task.potential is None and task.n_stages == 1):
        return lambda obs, infos, over: infos["vector_reward"].sum(1)
    return Shaped(task, gamma)


class Shaped:
    """gamma * potential after the step - potential before it, and the terms that no potential stands for.

    Over any episode the discounted sum of the first part is what the last step's potential is worth minus the first
    one's, whatever happened between: no way back and forth pays. A step to success pays all terms, and an end without
    success has the potential 0, so that a failure is worth no more than what the task says of it.
    """

    def __init__(self, task: StageTask, gamma: float) -> None:
        if task.potential is None:
            raise UserError(
                f"task {task.name!r} has no `potential`, which the learner's setting `scalar: shaped` needs; declare "
                f"one ({page('protocol.md')}), or take `scalar: paper`, the sum of the terms, which may pay for "
                "falling back"
            )
        self._potential, self._gamma = task.potential, gamma
        self._stood_for = np.isin(task.term_names, task.potential_terms)

    def __call__(self, obs: Observation, infos: Mapping[str, Any], over: NDArray[np.bool_]) -> Array:
        """See `Scalar`."""
        failed = infos["terminated"] & ~infos["is_success"]
        before = self._potential(obs["state"], infos["stage"])
        after = np.where(failed, 0.0, self._potential(infos["final_obs"]["state"], infos["next_stage"]))
        rewards = np.where(self._stood_for & ~infos["is_success"][:, None], 0.0, infos["vector_reward"])
        out: Array = self._gamma * after - before + rewards.sum(1)
        return out


class FirstEntry:
    """The reward vector with every bonus paid once an episode: coming back into a stage pays its progress terms alone.

    A bonus is what a term outside discovery pays for a step into a later stage.
    """

    def __init__(self, task: StageTask, n: int) -> None:
        self._bonuses = np.array([not term.discoverable for term in task.terms])
        self.reached = np.zeros(n, dtype=np.int64)
        """The latest stage that each world's episode has been in, 0 before its first step."""

    def __call__(self, infos: Mapping[str, Any], over: NDArray[np.bool_]) -> Array:
        """(n, n_terms) of the step that `infos` tells of; `over` says whose episode ended with it."""
        reached = np.maximum(self.reached, infos["stage"])
        again = (infos["next_stage"] > infos["stage"]) & (infos["next_stage"] <= reached)
        self.reached = np.where(over, 0, np.maximum(reached, infos["next_stage"]))
        rewards: Array = infos["vector_reward"]
        return np.where(again[:, None] & self._bonuses, np.minimum(rewards, 0.0), rewards)
