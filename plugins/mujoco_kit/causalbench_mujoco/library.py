"""Functions of libmujoco that compiled control steps call, by name: so numba can keep their machine code on disk.

`mjModel*`, `mjData*` and arrays travel as addresses: `model._address`, `data._address`, `array.ctypes.data`.
"""

from __future__ import annotations

from pathlib import Path

from causalbench.backend import external
from causalbench_mujoco.engine import mujoco


def _path() -> str:
    """Of the library that the mujoco package has loaded."""
    folder = Path(mujoco.__file__).parent
    found = [path for pattern in ("libmujoco.*", "mujoco.dll") for path in sorted(folder.glob(pattern))]
    if not found:
        raise ImportError(f"no MuJoCo library in {folder}")
    return str(found[0])


_LIBRARY = _path()

mj_step = external(_LIBRARY, "mj_step", "address", "address")
mj_step1 = external(_LIBRARY, "mj_step1", "address", "address")
mj_step2 = external(_LIBRARY, "mj_step2", "address", "address")
mj_jac_site = external(_LIBRARY, "mj_jacSite", "address", "address", "address", "address", "int32")
