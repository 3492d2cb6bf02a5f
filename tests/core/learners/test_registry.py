"""What a learner may be registered with, and what a problem gives it."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import pytest
from scenes import worlds_of
from training import METHOD

from causalbench.core.kinematic import make
from causalbench.core.learners.methods import METHODS
from causalbench.core.learners.registry import LEARNERS, Learner, TrainingProblem
from causalbench.core.learners.settings import OBSERVED, EvaluationSettings
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.errors import UserError


def nothing(*_: object) -> None:
    """Trains nothing and tells nobody."""


@dataclass(frozen=True)
class Plain:
    """Settings that say nothing of observations."""

    rates: tuple[float, ...] = field(default_factory=lambda: (0.1,))


@dataclass(frozen=True)
class Demanding:
    """Settings that no suite could leave out."""

    rate: float


@pytest.mark.parametrize(
    ("settings", "presets", "message"),
    [
        (dict, {}, "learner 'Mine': settings must be a dataclass whose fields have defaults"),
        (Demanding, {}, "learner 'Mine': settings must be a dataclass whose fields have defaults"),
        (Plain, {"fast": Demanding(1.0)}, "learner 'Mine': preset 'fast' is no Plain"),
    ],
)
def test_a_learner_that_a_suite_could_not_configure_is_refused(settings: type, presets: dict, message: str) -> None:
    with pytest.raises(UserError, match=message):
        Learner("Mine", settings, nothing, presets)


def test_every_method_names_a_learner_and_every_learner_has_a_preset_of_each_name() -> None:
    assert {method.learner for method in METHODS} == set(LEARNERS)
    for learner in LEARNERS.values():
        assert set(learner.presets) == {"quick", "paper"}
        assert learner.presets["quick"] == learner.settings()
        assert {"n_envs", *OBSERVED} <= {f.name for f in fields(learner.settings)}


@pytest.mark.parametrize(("settings", "gripper"), [(Plain(), True), (LEARNERS["SAC"].presets["paper"], False)])
def test_environments_of_a_problem_observe_what_its_settings_say(settings: object, gripper: bool) -> None:
    problem = TrainingProblem(
        TASK, worlds_of(TASK, make), METHOD["mSAC"], None, settings, EvaluationSettings(), 10, 0, nothing, nothing
    )  # fmt: skip
    one, many = problem.worlds(1), problem.vector_env(3)
    assert ("gripper" in one.observation_space.spaces) == ("features" in one.observation_space.spaces) == gripper
    assert many.single_observation_space == one.observation_space
    assert many.num_envs == 3
    one.close()
    many.close()
