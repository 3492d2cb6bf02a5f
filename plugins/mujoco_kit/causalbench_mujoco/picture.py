"""Pictures of a world. The only module that needs OpenGL; it is imported when the first picture is asked for."""

from __future__ import annotations

import atexit
import functools
import importlib
import os
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import FOV, Camera, CausalbenchError
from causalbench_mujoco.engine import mujoco

MAX_GEOMS = 1000


def draw(model: mujoco.MjModel, data: mujoco.MjData, width: int, height: int, camera: Camera) -> NDArray[np.uint8]:
    """RGB image (height, width, 3) of what `camera` sees, in any thread.

    Raises `CausalbenchError` where there is no OpenGL, and in a process forked from one that has drawn: OpenGL would
    wait for ever for threads that a fork does not copy.
    """
    if _DRAWN_IN[0] not in (None, os.getpid()):
        raise CausalbenchError(
            "no picture can be drawn here: this process was forked from one that had drawn already, which OpenGL does "
            'not survive. Start the process with multiprocessing\'s "spawn", or draw no picture before the fork'
        )
    with _ONE_AT_A_TIME:
        _DRAWN_IN[0] = os.getpid()
        if model.nmeshvert not in _PAINTERS:
            _PAINTERS[model.nmeshvert] = _Painter(model)
            atexit.register(_PAINTERS[model.nmeshvert].close)
        return _PAINTERS[model.nmeshvert].draw(model, data, width, height, camera)


_PAINTERS: dict[int, _Painter] = {}
"""One for each robot: a context takes a second to make."""
_ONE_AT_A_TIME = threading.Lock()
_DRAWN_IN: list[int | None] = [None]
"""The process in which OpenGL was first asked for."""


class _Painter:
    """An OpenGL context that holds the meshes; they are the same in every world, whatever its fixtures."""

    def __init__(self, model: mujoco.MjModel) -> None:
        model.vis.quality.offsamples = 0  # smooth edges would take three times as long without a graphics card
        try:
            self._gl, self._let_go = _context_type()(1, 1), _letting_go()
            self._gl.make_current()
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        except Exception as error:  # ImportError, AttributeError, FatalError, ...: whatever is missing
            raise CausalbenchError(
                f"pictures need OpenGL, which does not work here ({type(error).__name__}: {error}). Without a display: "
                "apt-get install libegl1 libopengl0 libgl1-mesa-dri"
            ) from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene = mujoco.MjvScene(model, MAX_GEOMS)
        self._options, self._view = mujoco.MjvOption(), mujoco.MjvCamera()
        self._options.flags[mujoco.mjtVisFlag.mjVIS_CONVEXHULL] = 1  # as it collides, of few vertices
        self._options.sitegroup[:] = 0
        for effect in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[effect] = 0

    def draw(
        self, model: mujoco.MjModel, data: mujoco.MjData, width: int, height: int, camera: Camera
    ) -> NDArray[np.uint8]:
        self._gl.make_current()
        try:
            return self._painted(model, data, width, height, camera)
        finally:
            self._let_go()  # or no other thread could draw

    def _painted(
        self, model: mujoco.MjModel, data: mujoco.MjData, width: int, height: int, camera: Camera
    ) -> NDArray[np.uint8]:
        if width > self._context.offWidth or height > self._context.offHeight:
            mujoco.mjr_resizeOffscreen(width, height, self._context)
        way = np.subtract(camera.at, camera.eye)
        model.vis.global_.fovy = FOV
        self._view.lookat, self._view.distance = camera.at, np.linalg.norm(way)
        self._view.azimuth = np.degrees(np.arctan2(way[1], way[0]))
        self._view.elevation = np.degrees(np.arctan2(way[2], np.hypot(way[0], way[1])))
        mujoco.mjv_updateScene(model, data, self._options, None, self._view, mujoco.mjtCatBit.mjCAT_ALL, self._scene)
        viewport, upside_down = mujoco.MjrRect(0, 0, width, height), np.empty((height, width, 3), np.uint8)
        mujoco.mjr_render(viewport, self._scene, self._context)
        mujoco.mjr_readPixels(upside_down, None, viewport, self._context)
        return upside_down[::-1].copy()

    def close(self) -> None:
        """Release OpenGL while the interpreter still can; a forked process leaves it to its parent."""
        if _DRAWN_IN[0] == os.getpid():
            self._gl.make_current()
            self._context.free()
            self._gl.free()


def _library() -> Any:
    """MuJoCo's module for the user's choice in MUJOCO_GL, or for EGL, which needs no display."""
    chosen = os.environ.get("MUJOCO_GL", "").lower()
    return importlib.import_module(f"mujoco.{chosen if chosen in ('osmesa', 'glfw') else 'egl'}")


def _context_type() -> Any:
    """MuJoCo's context of that library."""
    return _library().GLContext


def _letting_go() -> Callable[[], Any]:
    """What ends the hold that a thread has on its context: only one thread at a time may have it."""
    library = _library()
    if library.__name__ == "mujoco.glfw":
        return functools.partial(library.glfw.make_context_current, None)
    if library.__name__ == "mujoco.osmesa":
        return functools.partial(library.osmesa.OSMesaMakeCurrent, None, None, library.GL.GL_FLOAT, 0, 0)
    none, egl = library.EGL.EGL_NO_SURFACE, library.EGL
    return functools.partial(egl.eglMakeCurrent, library.EGL_DISPLAY, none, none, egl.EGL_NO_CONTEXT)
