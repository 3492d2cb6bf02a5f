"""Which releases of the simulator this plugin is known to work with. Imports none of them."""

from __future__ import annotations

from importlib import metadata

from causalbench.errors import BrokenVersionError

MUJOCO = "3.3"
"""The one release line of MuJoCo whose inertia layout `control.py` reads; robosuite breaks on later ones."""
ROBOSUITE = "1.5.2"
"""The one release whose models and controller `model.py` takes."""


def check_versions() -> None:
    """Raise `BrokenVersionError` unless the installed releases are ones that are known to work."""
    installed = metadata.version("mujoco")
    if installed.split(".")[:2] != MUJOCO.split("."):
        raise BrokenVersionError(
            f"backend 'robosuite' does not work with the installed mujoco {installed}; it needs {MUJOCO} "
            f'(3.3.7 is what it is tested with). Repair: pip install "mujoco==3.3.7"'
        )
    installed = metadata.version("robosuite")
    if installed != ROBOSUITE:
        raise BrokenVersionError(
            f"backend 'robosuite' takes the models and the controller of robosuite {ROBOSUITE}, but {installed} is "
            f'installed. Repair: pip install "robosuite=={ROBOSUITE}"'
        )
