"""Whose doing a reversal is, for policies of which that is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import backend_option
import numpy as np
import pytest

from causalbench.core.discovery.graph import manual_graph
from causalbench.core.learners.evaluation import Player
from causalbench.core.learners.reversal_causes import reversal_causes
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.scene_worlds import make_scene_worlds
from causalbench.core.staged.worlds import Worlds
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.core.world.scene import Scene
from causalbench.errors import UserError

Make = Callable[..., StageTaskEnv]
CAUSES = np.array([[name in stage.causal_actions() for name in TASK.actions] for stage in manual_graph(TASK).stages])


@dataclass
class Spoiler:
    """The scripted expert, that in `stage` does one other thing instead: `action` at `value`."""

    worlds: Worlds
    stage: int
    action: str
    value: float

    def predict(self, obs: Any, deterministic: bool = True) -> Any:
        chosen = self.worlds.expert()
        other = self.value * np.eye(len(TASK.actions))[TASK.actions.index(self.action)]
        chosen[self.worlds.stage == self.stage] = other
        return chosen.astype(np.float32), None


@pytest.mark.parametrize("backend", ["kinematic"])
@pytest.mark.parametrize(
    ("stage", "action", "value", "whose"),
    [
        (2, "armx", 1.0, "redundant"),  # away from above the box, where only turning pays
        (3, "army", -1.0, "redundant"),
        (3, "armz", 1.0, "causes"),  # up again, where going down pays
        (2, "armry", 1.0, ""),  # turns on and on, and never falls back
    ],
)
def test_a_fall_is_laid_to_what_did_it(make_pure: Make, stage: int, action: str, value: float, whose: str) -> None:
    env = make_pure()
    rows = list(reversal_causes(Spoiler(env.worlds, stage, action, value), env, CAUSES, 0, 5, True))
    (row,) = [row for row in rows if row.stage == stage]
    assert (row.reversals > 0) == bool(whose)
    assert row.reversals_repeated == row.reversals
    assert row.vanished_without_redundant == row.reversals * (whose == "redundant")
    assert row.vanished_without_causes == row.reversals * (whose == "causes")
    assert sum(row.reversals for row in rows) == row.reversals
    assert sum(row.steps_in_stage for row in rows) == TASK.horizon


@pytest.mark.parametrize("backend", backend_option.quick(backend_option.names()))
def test_taking_steps_again_leaves_the_episode_as_it_was(make_pure: Make, make_scene: Callable[[], Scene]) -> None:
    env = make_pure()
    worlds = make_scene_worlds(TASK, make_scene, 1)
    (played,) = Player(worlds, 5).play(Spoiler(worlds, 3, "armz", 1.0), [0], True)
    rows = list(reversal_causes(Spoiler(env.worlds, 3, "armz", 1.0), env, CAUSES, 0, 5, True))
    assert played.reversals == sum(row.reversals for row in rows) == sum(row.reversals_repeated for row in rows) > 0
    assert {row.stage: row.steps_in_stage for row in rows} == {
        stage: played.stages.count(stage) for stage in sorted(set(played.stages))
    }


@pytest.mark.parametrize("backend", ["kinematic"])
def test_worlds_that_do_not_restore_exactly_are_refused(make_pure: Make) -> None:
    env = make_pure()
    env.worlds.capabilities = frozenset()
    with pytest.raises(UserError, match="exact_restore"):
        next(reversal_causes(Spoiler(env.worlds, 2, "armx", 1.0), env, CAUSES, 0, 5, True))
