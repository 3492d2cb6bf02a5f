"""What a learner is: a record of settings and a function that trains a policy. The table holds the built-in ones.

A plugin adds a row through `causalbench_learners`; `Method.learner` names the one that a method trains with.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, asdict, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from causalbench.core.learners.methods import Method
from causalbench.core.learners.ppo import settings as ppo
from causalbench.core.learners.records import Evaluation, TrainingCounts
from causalbench.core.learners.sac import settings as sac
from causalbench.core.learners.sb3 import settings as sb3
from causalbench.core.learners.settings import EvaluationSettings, observed
from causalbench.errors import UserError

if TYPE_CHECKING:  # importing the built-in plugins loads this table, which thus must need neither torch nor Gymnasium
    from causalbench.core.discovery.graph import CausalGraph
    from causalbench.core.learners.checkpoint import Checkpoints
    from causalbench.core.staged.vector_env import StageTaskVectorEnv
    from causalbench.core.staged.worlds import MakeWorlds, Worlds
    from causalbench.core.tasks.stage_task import StageTask

OnEvaluation = Callable[[Evaluation, TrainingCounts], None]
OnProgress = Callable[[float, str], None]


class Policy(Protocol):
    """A trained policy, whose `predict` has stable-baselines3's signature."""

    def predict(
        self,
        observation: dict[str, Any],
        state: tuple[NDArray[Any], ...] | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], tuple[NDArray[Any], ...] | None]:
        """Actions (n_actions,) in [-1, 1] for one observation, or (n, n_actions) for a batch, and a recurrent state."""

    def save(self, folder: Path) -> None:
        """Write into `folder` what `Learner.load_policy` reads."""


class Trained(NamedTuple):
    """What `Learner.train` returns: the policy after the last step, and the counts of all steps."""

    policy: Policy
    counts: TrainingCounts


@dataclass(frozen=True)
class TrainingProblem:
    """Everything that a learner gets for a training.

    `graph` is the causal graph that the method trains with, None for a method without one. `settings` is the learner's
    own record. Training takes `env_steps` control steps of all worlds together and is deterministic in `seed`.
    `on_evaluation` wants every evaluation that `evaluation` asks for, `on_progress` a share in [0, 1] and a few words
    after every step; `Examiner` does both. `checkpoints` says where a learner that can go on after a kill keeps what it
    goes on from; None where nothing is to be kept.
    """

    task: StageTask
    make_worlds: MakeWorlds
    method: Method
    graph: CausalGraph | None
    settings: Any
    evaluation: EvaluationSettings
    env_steps: int
    seed: int
    on_evaluation: OnEvaluation
    on_progress: OnProgress
    checkpoints: Checkpoints | None = None

    def worlds(self, n: int) -> Worlds:
        """`n` new worlds of the task, shape (n,); they observe what the settings say: the keys of `OBSERVED`."""
        worlds = self.make_worlds(n)
        worlds.choose_observation(*self._observed())
        return worlds

    def vector_env(self, n: int) -> StageTaskVectorEnv:
        """A vector environment of `n` new worlds; they observe as those of `worlds`."""
        from causalbench.core.staged.vector_env import StageTaskVectorEnv

        return StageTaskVectorEnv(self.make_worlds(n), *self._observed())

    def _observed(self) -> tuple[Any, ...]:
        return tuple(observed(asdict(self.settings)).values())


@dataclass(frozen=True)
class Learner:
    """A learner, as a plugin registers it through `causalbench_learners`.

    `settings` is a frozen dataclass whose fields, all with defaults, are the keys of a suite's `learner` section;
    bounds are annotated (`Annotated[int, Gt(0)]`, of annotated-types). `presets` are named instances of it, and `about`
    is a line for people. `train` imports heavy libraries when it is called, never before; it raises `DivergedError`
    for a loss that explodes or is not finite. `modules` are the optional imports that it needs and `extra` the pip
    requirement that installs them. `load_policy` reads what its policies save; None: they are `StagedPolicy`.
    """

    name: str
    settings: type[Any]
    train: Callable[[TrainingProblem], Trained]
    presets: Mapping[str, Any] = field(default_factory=dict)
    about: str = ""
    modules: tuple[str, ...] = ()
    extra: str = ""
    load_policy: Callable[[Path], Policy] | None = None

    def __post_init__(self) -> None:
        if not is_dataclass(self.settings) or not all(map(_has_default, fields(self.settings))):
            raise UserError(f"learner {self.name!r}: settings must be a dataclass whose fields have defaults")
        for preset, record in self.presets.items():
            if not isinstance(record, self.settings):
                raise UserError(f"learner {self.name!r}: preset {preset!r} is no {self.settings.__name__}")


def _has_default(setting: Field[Any]) -> bool:
    return setting.default is not MISSING or setting.default_factory is not MISSING


def _staged(module: str, name: str) -> Callable[[TrainingProblem], Trained]:
    """Training in the staged loop with the `StagedLearner` class `name` of a module beside this one."""

    def train(problem: TrainingProblem) -> Trained:
        from causalbench.core.learners.training import train_staged

        return train_staged(problem, getattr(_beside(module), name))

    return train


def _by(module: str, name: str) -> Callable[[TrainingProblem], Trained]:
    """The function `name` of a module beside this one, imported when it is called."""
    return lambda problem: getattr(_beside(module), name)(problem)


def _beside(module: str) -> Any:
    return importlib.import_module(f"causalbench.core.learners.{module}")


SB3 = (("stable_baselines3",), "stable-baselines3")

LEARNERS: Mapping[str, Learner] = {
    row.name: row
    for row in (
        Learner("SAC", sac.SACSettings, _staged("sac.staged", "StagedSAC"), sac.PRESETS, "one SAC per stage"),
        Learner("PPO", ppo.PPOSettings, _staged("ppo.staged", "StagedPPO"), ppo.PRESETS, "one PPO per stage"),
        Learner("SB3-SAC", sb3.SB3SACSettings, _by("sb3.training", "train_sac"), sb3.SAC_PRESETS, sb3.ABOUT, *SB3),
        Learner("SB3-PPO", sb3.SB3PPOSettings, _by("sb3.training", "train_ppo"), sb3.PPO_PRESETS, sb3.ABOUT, *SB3),
    )
}
