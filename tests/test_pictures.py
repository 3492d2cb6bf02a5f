"""Pictures in every simulator, and that nobody who asks for none needs what draws them."""

from __future__ import annotations

import os
import subprocess
import sys

import backend_option
import numpy as np
import pytest
from numpy.typing import NDArray

from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.world.cameras import find_camera
from causalbench.errors import UserError
from causalbench.registration import make_env

WITHOUT_GL = """
import os
import sys

BLOCKED = ("OpenGL",) if sys.argv[1] == "robosuite" else ("OpenGL", "glfw")

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in BLOCKED or name in ("mujoco.egl", "mujoco.osmesa", "mujoco.glfw"):
            raise ImportError(f"{name} is blocked")

sys.meta_path.insert(0, Blocked())
import numpy as np
from causalbench.registration import make_env
env = make_env(backend=sys.argv[1])
env.reset(seed=0)
assert "MUJOCO_GL" not in os.environ, "a child process would inherit it"
for _ in range(3):
    env.step(np.zeros(len(env.action_names)))
try:
    env.worlds.scene.render(64, 48)
    print("drawn")
except Exception as error:
    print(type(error).__name__, error)
"""


@pytest.mark.parametrize("backend", backend_option.names())
def test_state_alone_needs_no_renderer(backend: str) -> None:
    """MuJoCo draws with OpenGL; Bullet's and the kinematic pictures are drawn by the processor alone.

    robosuite imports glfw, a window library that brings all it needs, by itself.
    """
    plain = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    call = [sys.executable, "-c", WITHOUT_GL, backend]
    done = subprocess.run(call, capture_output=True, text=True, check=True, env=plain)
    if backend in ("kinematic", "pybullet"):
        assert done.stdout == "drawn\n"
    else:
        assert done.stdout.startswith("CausalbenchError pictures need OpenGL")
        assert "is blocked" in done.stdout
        assert "apt-get install libegl1" in done.stdout


def reds(picture: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Pixels of the target, the only red thing in every simulator."""
    red, green, blue = picture.astype(int).transpose(2, 0, 1)
    return (red > 2 * green) & (red > 2 * blue)


def projected(env: StageTaskEnv, point: NDArray[np.float64], size: tuple[int, int], name: str) -> NDArray[np.float64]:
    """(column, row) at which a pinhole camera of 45 degrees sees a point of the world."""
    camera = find_camera(env.worlds.scene.spec, name)
    right, up, forward = camera.axes()
    offset = point - np.array(camera.eye)
    scale = size[1] / 2 / np.tan(np.radians(22.5)) / (offset @ forward)
    return np.array([size[0] / 2 + scale * (offset @ right), size[1] / 2 - scale * (offset @ up)]) - 0.5


@pytest.mark.parametrize("backend", backend_option.names())
@pytest.mark.parametrize("size", [(64, 48), (320, 240)])
def test_the_box_is_where_a_pinhole_camera_sees_it(backend: str, size: tuple[int, int]) -> None:
    env = make_env(backend=backend)
    for seed in range(3):
        env.reset(seed=seed)
        pixels = np.argwhere(reds(env.worlds.scene.render(*size)))
        assert len(pixels) >= 3
        middle = np.median(pixels[:, ::-1], 0)
        expected = projected(env, env.worlds.facts.object_position, size, "scene")
        assert np.abs(middle - expected).max() < 1.0 + 0.01 * size[0]
        hand = projected(env, env.worlds.facts.eef_position, size, "scene")
        assert (hand > 0).all()
        assert (hand < np.array(size) - 1).all()
    env.close()


def test_a_room_shows_the_target(mobile_env: StageTaskEnv) -> None:
    mobile_env.reset(seed=0)
    size = (320, 240)
    pixels = np.argwhere(reds(mobile_env.worlds.scene.render(*size, "room")))
    expected = projected(mobile_env, mobile_env.worlds.facts.object_position, size, "room")
    assert np.abs(np.median(pixels[:, ::-1], 0) - expected).max() < 2.0


def test_a_camera_that_does_not_exist_is_named(backend: str) -> None:
    env = make_env(backend=backend)
    env.reset(seed=0)
    with pytest.raises(UserError, match=r"unknown camera of backend.*'room'.*Known: scene"):
        env.worlds.scene.render(64, 48, "room")
    env.close()


@pytest.mark.parametrize("backend", backend_option.names())
def test_pictures_of_several_worlds_do_not_mix(backend: str) -> None:
    """Worlds of one process share what draws them."""
    alone = []
    for seed in (0, 1):
        env = make_env(backend=backend)
        env.reset(seed=seed)
        alone.append(env.worlds.scene.render(64, 48))
        env.close()
    first, second = make_env(backend=backend), make_env(backend=backend)
    first.reset(seed=0)
    second.reset(seed=1)
    second.worlds.scene.render(128, 96)
    together = [first.worlds.scene.render(64, 48), second.worlds.scene.render(64, 48)]
    assert np.array_equal(alone, together)
    first.close()
    assert np.array_equal(second.worlds.scene.render(64, 48), alone[1])
    second.close()


def test_an_environment_shows_its_scene(backend: str) -> None:
    env = make_env(backend=backend, render_mode="rgb_array")
    env.reset(seed=0)
    picture = env.render()
    assert picture is not None
    assert picture.shape == (360, 480, 3)
    env.close()
