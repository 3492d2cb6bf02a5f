"""Which releases this plugin is known to work with. Imports none of them."""

from __future__ import annotations

from importlib import metadata

from causalbench.errors import BrokenVersionError

TESTED = {"pybullet": "3.2.7", "mujoco": "3.3.7", "gymnasium-robotics": "1.4.2"}
MUJOCO_LOW, MUJOCO_HIGH = (3, 3), (3, 10)
"""First release line of MuJoCo that compiles the Fetch assets and the first one that is not known to."""


def check_versions() -> None:
    """Raise `BrokenVersionError` unless the installed releases are ones that are known to work."""
    for name, tested in TESTED.items():
        installed = metadata.version(name)
        if name == "mujoco":
            works = MUJOCO_LOW <= tuple(int(part) for part in installed.split(".")[:2]) < MUJOCO_HIGH
        else:
            works = installed == tested
        if not works:
            raise BrokenVersionError(
                f"backend 'pybullet' is not known to work with the installed {name} {installed}; it is tested with "
                f'{tested}. Repair: pip install "{name}=={tested}"'
            )
