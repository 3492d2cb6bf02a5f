"""The ids by which Gymnasium knows the installed tasks.

A plugin names those of its tasks as entry points, so that `import causalbench` registers them all and loads no plugin.
"""

from __future__ import annotations

import importlib.metadata
import logging
import sys
from pathlib import Path

GROUP = "causalbench.environments"
"""The entry points that say which ids a plugin's tasks have: id = name of the task."""
OWN = {
    "causalbench/PureManipulation-v0": "pure_manipulation",
    "causalbench/PureManipulationDense-v0": "pure_manipulation_dense",
    "causalbench/MobileManipulation-v1": "mobile_manipulation",
    "causalbench/Stack-v0": "stack",
}
"""The same of causalbench's own tasks."""


def environment_ids() -> dict[str, str]:
    """Id -> name of the task, of every plugin's tasks and of causalbench's own; no plugin is loaded."""
    found = importlib.metadata.entry_points(group=GROUP)
    return {point.name: point.value for point in sorted(found, key=lambda point: point.name)} | OWN


def register_envs() -> None:
    """Register the id of every installed task; imports Gymnasium, but no simulator, no torch and no plugin.

    An id that Gymnasium refuses is a plugin's mistake: it is logged and stops nothing.
    """
    import gymnasium
    from gymnasium.envs.registration import WrapperSpec

    checked = (WrapperSpec("WithinHorizon", "causalbench.registration:within_horizon", {}),)
    for env_id, task in environment_ids().items():
        if env_id in gymnasium.registry:
            continue
        try:
            make = "causalbench.registration:make_env"
            gymnasium.register(env_id, make, kwargs={"task": task}, additional_wrappers=checked)
        except gymnasium.error.Error as error:
            logging.getLogger(__name__).warning("environment id %r of task %r: %s", env_id, task, error)


def register_on_import() -> None:
    """Call `register_envs`, except in the command `causalbench`, whose `--help` must not wait for Gymnasium."""
    if not is_command(sys.argv, sys.orig_argv):
        register_envs()


def is_command(argv: list[str], orig_argv: list[str]) -> bool:
    """Whether a process with these arguments is the command `causalbench`: its script or `python -m causalbench`."""
    if argv and Path(argv[0]).stem == "causalbench":
        return True
    words = [word for word in orig_argv[1:] if not word.startswith("-") or word == "-m"]
    return words[:2] == ["-m", "causalbench"]
