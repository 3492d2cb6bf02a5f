"""Same state, other action: random sequences through a stage, from each state of which any action can be tried."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.core.discovery.samples.collect import model_inputs
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.tasks.stages import Transition, judge
from causalbench.core.tasks.task import Task
from causalbench.core.world.capabilities import Capability
from causalbench.core.world.facts import Facts
from causalbench.core.world.scene import Scene

Array = NDArray[np.float64]


class Walk:
    """Visits states of `stage` as random sequences do: `visit`, then `take` what it drew and `reward_of` anything else.

    A step is one action, held for `action_repeat` control steps. A sequence ends with a step that leaves the stage, and
    after `length` steps.
    """

    def __init__(
        self, task: Task, scene: Scene, stage: int, rng: np.random.Generator, length: int, action_repeat: int = 1
    ) -> None:
        self.task, self.stage, self.length, self.rng = task, stage, length, rng
        self.action_repeat = action_repeat
        self.terms = task.stage_terms(stage, discoverable_only=True)
        self.exact = Capability.EXACT_RESTORE in scene.spec.capabilities
        self.sequence = -1  # number of the sequence that the state belongs to
        self.ended = self.finished = 0  # sequences that are over, and those of them that finished the stage
        self._env = StageTaskEnv(task, scene)
        self._columns = [task.term_names.index(name) for name in self.terms]
        self._indices = np.array([scene.spec.actions.index(a) for a in task.actions])
        self._full = np.zeros(len(scene.spec.actions))
        self._over, self._left = True, 0
        self._start = self._after = b""  # snapshots of the visited state and of that after the drawn action
        self._elsewhere = False
        self._before: Facts

    def visit(self) -> Array:
        """Move to the next state; returns the random action (n_actions,) to take there. Raises `LayoutDrawError`."""
        if self._over:
            self._env.reset(seed=int(self.rng.integers(2**31)), options={"stage": self.stage})
            self._left = self.length
            self.sequence += 1
        elif self._elsewhere:
            self._env.scene.restore(self._after)
        self._start, self._before = self._env.scene.snapshot(), self._env.scene.facts()
        return self.rng.uniform(-1.0, 1.0, len(self.task.actions))

    def take(self, action: Array) -> Array:
        """As `reward_of`, and the sequence goes on from there."""
        reward, result = self._try(action)
        self._left -= 1
        finished = int(result.next_stage) > self.stage or bool(result.success)
        fell_back = int(result.next_stage) < self.stage
        self._over = finished or fell_back or self._left == 0 or not np.isfinite(reward).all()
        self.ended += self._over
        self.finished += finished
        self._after, self._elsewhere = self._env.scene.snapshot(), False
        return reward

    def reward_of(self, action: Array) -> Array:
        """(n_terms,) rewards of the stage's terms for `action` (n_actions,) in the visited state."""
        self._elsewhere = True
        return self._try(action)[0]

    def compare(self) -> Array:
        """(n_actions + 2, n_terms) rewards in the next state: the drawn action, it again, it with each action at 0."""
        drawn = self.visit()
        tried = np.tile(drawn, (len(drawn) + 1, 1))
        tried[np.arange(1, len(drawn) + 1), np.arange(len(drawn))] = 0.0
        others = [self.reward_of(action) for action in tried]
        return np.array([self.take(drawn), *others])

    def _try(self, action: Array) -> tuple[Array, Transition]:
        scene = self._env.scene
        scene.restore(self._start)
        self._full[self._indices] = action
        for _ in range(self.action_repeat):
            scene.step(self._full)
        result = judge(self.task, np.array(self.stage), self._before, action, scene.facts())
        return result.vector_reward[self._columns], result

    def model_inputs(self) -> NDArray[np.float32]:
        """(n_state + 1,) the visited state, as in `Samples`."""
        return model_inputs(self.task, self._before)
