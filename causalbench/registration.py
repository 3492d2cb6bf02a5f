"""Environments by name: `make_env`, and the ids that `gymnasium.make` knows once causalbench is imported."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from causalbench.core.staged.env import StageTaskEnv
    from causalbench.core.staged.observation import Observe
    from causalbench.plugins.manager import Plugins


def register_envs() -> None:
    """Register every installed task in Gymnasium by its `env_id`; imports no simulator and no torch."""
    from causalbench.plugins.manager import when_installed

    when_installed(_register)


def _register(plugins: Plugins) -> None:
    import gymnasium

    for task in plugins.tasks.values():
        if task.env_id not in gymnasium.registry:
            gymnasium.register(task.env_id, entry_point="causalbench.registration:make_env", kwargs={"task": task.name})


def register_with_gymnasium() -> None:
    """Call `register_envs` now if Gymnasium is imported, else as soon as it is.

    Gymnasium 1 has no entry point for environments, and importing it takes longer than all of `causalbench --help`.
    """
    if "gymnasium" in sys.modules:
        register_envs()
    else:
        sys.meta_path.insert(0, _GymnasiumWatch())


class _GymnasiumWatch(MetaPathFinder):
    """Finds nothing itself; lets the import of `gymnasium` be followed by `register_envs`, once."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The spec that the other finders give for gymnasium; None for all else."""
        if fullname != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        if spec is None or spec.loader is None:
            return spec
        execute = spec.loader.exec_module

        def execute_and_register(module: ModuleType) -> None:
            execute(module)
            register_envs()

        spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec


def make_env(
    task: str = "pure_manipulation",
    backend: str | None = None,
    render_mode: str | None = None,
    observe_gripper: bool = True,
    observe: Observe = "state",
    features: bool = True,
    **backend_options: Any,
) -> StageTaskEnv:
    """A task in one new world of a backend; `backend_options` go to the backend's `make`, or the task's for it.

    Without a `backend` it is "kinematic", or the first that a task over Gymnasium environments names.
    `observe="sectors"` adds the LiDAR's sectors, `observe="paper"` what the paper's agents see beside the state, and
    `features=False` leaves out the task's features, see `core.staged.observation.Observer`.

    Raises `UnknownNameError` for a task or backend that does not exist, `BackendLoadError` for one that lacks its
    simulator and `UserError` for one that cannot run the task.
    """
    from causalbench.core.staged.env import StageTaskEnv
    from causalbench.plugins.manager import installed
    from causalbench.plugins.venues import venue_of, worlds_maker

    plugins = installed()
    chosen = plugins.task(task)
    make_worlds = worlds_maker(plugins.backend(backend or venue_of(chosen).home), chosen, backend_options)
    env = StageTaskEnv(make_worlds(), render_mode, observe_gripper, observe, features)
    env.make_worlds = make_worlds
    return env
