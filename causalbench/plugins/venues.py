"""What a task is played in: scenes of a backend, or Gymnasium environments of its own.

The only place that tells the two kinds of tasks apart; whoever plays, plans or identifies a task asks its venue.
"""

from __future__ import annotations

import functools
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from causalbench.core.tasks.changes.changed_task import ChangedTask
from causalbench.core.tasks.gym_task import GymTask
from causalbench.core.tasks.stage_task import StageTask
from causalbench.core.tasks.task import Task
from causalbench.core.world.capabilities import EVERY_SCENE, Capability
from causalbench.errors import CausalbenchError, UserError
from causalbench.plugins.backends import NO_OPTIONS, Backend, bound, missing_modules
from causalbench.plugins.environment_ids import register_envs

if TYPE_CHECKING:  # what simulates is imported when worlds are made
    from causalbench.core.staged.worlds import MakeWorlds

Options = Mapping[str, Any]


class Venue(Protocol):
    """Where one task is played. `options` are those that a user gives, beside what the task itself asks for."""

    @property
    def home(self) -> str:
        """The backend that plays the task where nobody names one."""

    @property
    def modules(self) -> tuple[str, ...]:
        """The imports that the task needs beside its backend's."""

    def check_options(self, backend: Backend, options: Options) -> None:
        """Raise a `UserError`, which says what exists, for options that the backend does not take."""

    def refusal(self, backend: Backend, options: Options = NO_OPTIONS) -> str:
        """Why the backend cannot run the task, in a sentence; "" if it can. Makes no world."""

    def capabilities(self, backend: Backend, options: Options = NO_OPTIONS) -> frozenset[Capability]:
        """What worlds in a backend that does not refuse can do, pictures aside."""

    def make_worlds(self, backend: Backend, options: Options = NO_OPTIONS) -> MakeWorlds:
        """Makes worlds in a backend that does not refuse; it pickles if what it is made of does."""

    def trace_hash(self) -> str:
        """A hash of what the task does on the kinematic backend; "" where that cannot run it.

        Raises `UserError`, which says where, when the task's own code raises.
        """


def venue_of(task: StageTask) -> Venue:
    """Where `task` is played. Raises `UserError` for a task of neither kind."""
    if isinstance(task, Task):
        return _Scenes(task)
    if isinstance(task, GymTask):
        return _Environments(task)
    raise UserError(f"task {task.name!r} is a {type(task).__name__}, expected a Task or a GymTask")


@dataclass(frozen=True)
class _Scenes:
    task: Task
    home = "kinematic"
    modules = ()

    def _options(self, options: Options) -> Options:
        return {**self.task.scene_options, **options}

    def check_options(self, backend: Backend, options: Options) -> None:
        if backend.make is not None:
            backend.maker(options)

    def refusal(self, backend: Backend, options: Options = NO_OPTIONS) -> str:
        task = self.task
        try:
            variant = backend.variant(self._options(options))
        except UserError as error:
            return f"backend {backend.name!r} cannot run task {task.name!r}: {error}"
        absent = sorted(task.requires - variant.capabilities)
        if not absent:
            return ""
        return (
            f"backend {backend.name!r} cannot run task {task.name!r}: its robot ({variant.robot}) lacks "
            f"{', '.join(absent)}; `causalbench backends` lists what each can do"
        )

    def capabilities(self, backend: Backend, options: Options = NO_OPTIONS) -> frozenset[Capability]:
        return backend.variant(self._options(options)).capabilities | EVERY_SCENE

    def make_worlds(self, backend: Backend, options: Options = NO_OPTIONS) -> MakeWorlds:
        from causalbench.core.staged.scene_worlds import make_scene_worlds

        make = functools.partial(make_scene_worlds, self.task, backend.maker(self._options(options)))
        if not (isinstance(self.task, ChangedTask) and self.task.lag):
            return make
        from causalbench.core.staged.lagged_worlds import LaggedWorlds

        return functools.partial(make, kind=LaggedWorlds)

    def trace_hash(self) -> str:
        from causalbench.core.kinematic.task_trace import trace_hash

        try:
            return trace_hash(self.task)
        except CausalbenchError:  # other actions or capabilities than the kinematic backend's
            return ""
        except Exception as error:  # a stranger's code may raise anything
            place = traceback.extract_tb(error.__traceback__)[-1]
            raise UserError(
                f"task {self.task.name!r}: to know what it does it is played on the kinematic backend, where it raises "
                f"{type(error).__name__}: {error} ({place.filename}:{place.lineno}, in {place.name})"
            ) from error


@dataclass(frozen=True)
class _Environments:
    task: GymTask

    @property
    def home(self) -> str:
        return next(iter(self.task.environments))

    @property
    def modules(self) -> tuple[str, ...]:
        return self.task.modules

    def check_options(self, backend: Backend, options: Options) -> None:
        if make := self.task.environments.get(backend.name):
            bound(make, options, f"options of task {self.task.name!r} in backend {backend.name!r}")

    def refusal(self, backend: Backend, options: Options = NO_OPTIONS) -> str:
        task, cannot = self.task, f"backend {backend.name!r} cannot run task {self.task.name!r}"
        if backend.name not in task.environments:
            return f"{cannot}, which has environments for {', '.join(task.environments)} alone"
        if missing := missing_modules(task.modules):
            return f"{cannot}: its environments need {', '.join(missing)}, not installed here"
        return ""

    def capabilities(self, backend: Backend, options: Options = NO_OPTIONS) -> frozenset[Capability]:
        return self.task.capabilities

    def make_worlds(self, backend: Backend, options: Options = NO_OPTIONS) -> MakeWorlds:
        from causalbench.core.staged.gym_worlds import make_gym_worlds

        register_envs()  # in the command, too, the environments may be made by our ids
        return functools.partial(make_gym_worlds, self.task, backend.name, options)

    def trace_hash(self) -> str:
        return ""


def worlds_maker(backend: Backend, task: StageTask, options: Options = NO_OPTIONS) -> MakeWorlds:
    """A function that makes new worlds of `task` in `backend`, and that pickles if what it is made of does.

    Raises `UserError` where the backend takes no such `options`, or cannot run the task.
    """
    venue = venue_of(task)
    venue.check_options(backend, options)
    if refusal := venue.refusal(backend, options):
        raise UserError(refusal)
    return venue.make_worlds(backend, options)
