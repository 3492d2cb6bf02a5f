"""Which releases of the simulator this plugin is known to work with. Imports none of them."""

from __future__ import annotations

from importlib import metadata

from causalbench.errors import BrokenVersionError

MUJOCO_LOW, MUJOCO_HIGH = (3, 3), (3, 10)
"""First release line of MuJoCo that works and the first one that is not known to: 3.17 and 4.0 break Fetch."""
GYMNASIUM_ROBOTICS = "1.4.2"
"""The one release whose Fetch assets `model.py` edits."""


def check_versions() -> None:
    """Raise `BrokenVersionError` unless the installed releases are ones that are known to work."""
    installed = metadata.version("mujoco")
    parts = tuple(int(part) for part in installed.split(".")[:2])
    if not MUJOCO_LOW <= parts < MUJOCO_HIGH:
        low, high = (".".join(map(str, bound)) for bound in (MUJOCO_LOW, MUJOCO_HIGH))
        raise BrokenVersionError(
            f"backend 'gymrob' does not work with the installed mujoco {installed}; it needs >={low},<{high} "
            f'(3.3.7 is what it is tested with). Repair: pip install "mujoco==3.3.7"'
        )
    installed = metadata.version("gymnasium-robotics")
    if installed != GYMNASIUM_ROBOTICS:
        raise BrokenVersionError(
            f"backend 'gymrob' edits the Fetch assets of gymnasium-robotics {GYMNASIUM_ROBOTICS}, but {installed} is "
            f'installed. Repair: pip install "gymnasium-robotics=={GYMNASIUM_ROBOTICS}"'
        )
