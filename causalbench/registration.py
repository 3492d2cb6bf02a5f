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
