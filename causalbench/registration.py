"""Environments by the names of tasks and backends."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from causalbench.errors import UserError

if TYPE_CHECKING:
    import gymnasium

    from causalbench.core.staged.env import StageTaskEnv
    from causalbench.core.staged.observation import Observe


def make_env(
    task: str = "pure_manipulation",
    backend: str | None = None,
    render_mode: str | None = None,
    observe_gripper: bool = True,
    observe: Observe = "state",
    features: bool = True,
    **backend_options: Any,
) -> StageTaskEnv:
    """Make a Gymnasium environment of `task` in one new world of `backend`.

    - `backend`: by default "kinematic", or the first that a task over Gymnasium environments names.
    - `render_mode`: "rgb_array" or None.
    - `observe_gripper`: whether the opening of the gripper is observed, in tasks that observe it.
    - `observe`: "state", "sectors", which adds 20 numbers of the LiDAR, or "paper", which adds the paper's image or
      LiDAR scan.
    - `features`: whether the features of the task are observed.
    - `backend_options`: keyword arguments of the backend's `make`, or of the function of a task over Gymnasium
      environments.

    Raises `UnknownNameError` for a task or a backend that does not exist, `BackendLoadError` for a backend without its
    simulator, and `UserError` for a backend that cannot run the task.
    """
    from causalbench.core.staged.env import StageTaskEnv
    from causalbench.plugins.manager import installed
    from causalbench.plugins.venues import venue_of, worlds_maker

    plugins = installed()
    chosen = plugins.task(task)
    make_worlds = worlds_maker(
        plugins.backend(venue_of(chosen).home if backend is None else backend), chosen, backend_options
    )
    env = StageTaskEnv(make_worlds(), render_mode, observe_gripper, observe, features)
    env.make_worlds = make_worlds
    return env


def within_horizon(env: gymnasium.Env[Any, Any]) -> gymnasium.Env[Any, Any]:
    """`env` itself, as `gymnasium.make` made it, around which it has put the time limit `max_episode_steps`, if any.

    Raises `UserError` for a limit above the task's horizon, which would end no episode.
    """
    limit, task = env.spec and env.spec.max_episode_steps, env.get_wrapper_attr("task")
    if limit is not None and limit > task.horizon:
        raise UserError(
            f"max_episode_steps={limit}: an episode of {task.name!r} ends after {task.horizon} control steps, its "
            "horizon, which is part of the task; give at most that, or a task of your own"
        )
    return env


# So `gymnasium.make` knows which modes there are, and adds its own "human" and "rgb_array_list" to them.
make_env.metadata = {"render_modes": ["rgb_array"]}  # type: ignore[attr-defined]
