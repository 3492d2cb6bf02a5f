"""The state of environments that others made with MuJoCo: all that a step depends on, and a way back to it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench_mujoco.engine import mujoco

STATE = mujoco.mjtState.mjSTATE_INTEGRATION  # with servo targets, mocap bodies and the solver's warm start


def state_of(model: Any, data: Any) -> NDArray[np.float64]:
    """The state (`mj_stateSize(model, STATE)`,)."""
    state = np.empty(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, state, STATE)
    return state


def set_state(model: Any, data: Any, state: NDArray[np.float64]) -> None:
    """The way back, to the bit, and what derives from it."""
    mujoco.mj_setState(model, data, state, STATE)
    mujoco.mj_forward(model, data)
    mujoco.mj_setState(model, data, state, STATE)  # computing that has warmed the solver otherwise
