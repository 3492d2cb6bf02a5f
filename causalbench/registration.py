"""Environments by name: `make_env`, and the ids that `gymnasium.make` knows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from causalbench.plugins import installed

if TYPE_CHECKING:
    from causalbench.core.env import StageTaskEnv


def register_envs() -> None:
    """Register the built-in tasks in Gymnasium, which calls this when it is imported.

    So it imports no simulator, no torch and no plugin; a plugin's task is reached through `make_env(task=...)`.
    """
    import gymnasium

    from causalbench.builtins import TASKS

    for task in TASKS:
        gymnasium.register(task.env_id, entry_point="causalbench.registration:make_env", kwargs={"task": task.name})


def make_env(
    task: str = "pure_manipulation",
    backend: str = "kinematic",
    render_mode: str | None = None,
    observe_gripper: bool = True,
    **backend_options: Any,
) -> StageTaskEnv:
    """A task in one new scene of a backend; `backend_options` go to the backend's `make`.

    Raises `UnknownNameError` for a task or backend that does not exist and `BackendLoadError` for one that lacks
    its simulator.
    """
    from causalbench.core.env import StageTaskEnv

    plugins = installed()
    scene = plugins.backend(backend).make(**backend_options)
    return StageTaskEnv(plugins.task(task), scene, render_mode, observe_gripper)
