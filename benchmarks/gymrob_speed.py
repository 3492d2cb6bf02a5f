"""What `causalbench_gymrob` costs beside raw physics: python benchmarks/gymrob_speed.py (about a minute, one core).

Rivals take turns (A B A B ...) on the same states and actions, random actions in motion; figures are medians of
control steps or of turns. Needs an otherwise idle core.
"""

from __future__ import annotations

import statistics
import warnings

import mujoco
import numpy as np
from numpy.typing import NDArray
from timing import EPISODE, STEPS, env_overhead, random_actions, timed

from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench_gymrob import make
from causalbench_gymrob.scene import GymrobScene

Array = NDArray[np.float64]

TIMESTEPS = (0.005, 0.002)  # s
SEGMENT = 20  # control steps per turn against the stock environment
TURNS = 12


def against_raw(timestep: float) -> tuple[float, float]:
    """Median seconds of step + facts and of the raw `mj_step`s of the same substeps.

    Each control step runs twice from one snapshot: once through the scene and once as one `mj_step` call with the
    servo targets that the scene set, in alternating order.
    """
    scene = make(timestep=timestep)
    env = StageTaskEnv(SceneWorlds(TASK, scene))
    assert isinstance(scene, GymrobScene)
    ours, raw = [], []
    for i, action in enumerate(random_actions(0, STEPS)):
        if i % EPISODE == 0:
            env.reset(seed=i)
        before = scene.snapshot()
        scene.step(action)
        targets = scene.data.ctrl.copy()
        for rival in ("ours", "raw") if i % 2 else ("raw", "ours"):
            scene.restore(before)
            if rival == "ours":
                ours.append(timed(lambda a=action: (scene.step(a), scene.facts())))
                after = scene.snapshot()
            else:
                scene.data.ctrl[:] = targets
                raw.append(timed(lambda: mujoco.mj_step(scene.model, scene.data, scene.substeps)))
        scene.restore(after)
    return statistics.median(ours), statistics.median(raw)


def stock_env(timestep: float) -> object:
    """Stock `FetchPickAndPlace-v4` with our physics timestep and the same control period of 0.04 s."""
    warnings.filterwarnings("ignore")
    import gymnasium
    import gymnasium_robotics

    gymnasium.register_envs(gymnasium_robotics)
    env = gymnasium.make("FetchPickAndPlace-v4", max_episode_steps=100_000)
    period = env.unwrapped.dt
    env.unwrapped.model.opt.timestep = timestep
    env.unwrapped.n_substeps = round(period / timestep)
    env.reset(seed=0)
    return env


def against_stock(timestep: float) -> tuple[float, float]:
    """Simulated seconds per second of our environment and of the stock one, medians over turns."""
    env, stock = StageTaskEnv(SceneWorlds(TASK, make(timestep=timestep))), stock_env(timestep)
    rng = np.random.default_rng(2)
    ours, theirs = [], []
    for turn in range(TURNS):
        env.reset(seed=turn)
        stock.reset(seed=turn)
        actions = random_actions(turn, SEGMENT)
        stock_actions = rng.uniform(-1, 1, (SEGMENT, 4)).astype(np.float32)
        taken = timed(lambda a=actions: [env.step(action) for action in a])
        ours.append(SEGMENT * env.worlds.scene.spec.control_dt / taken)
        taken = timed(lambda a=stock_actions: [stock.step(action) for action in a])
        theirs.append(SEGMENT * stock.unwrapped.n_substeps * timestep / taken)
    return statistics.median(ours), statistics.median(theirs)


def main() -> None:
    """Print the three comparisons at each timestep."""
    for timestep in TIMESTEPS:
        print(f"physics timestep {timestep} s, control at 10 Hz")
        ours, raw = against_raw(timestep)
        print(f"  step + facts {ours * 1e6:6.0f} us, raw mj_step {raw * 1e6:6.0f} us: {raw / ours:.2f} of raw speed")
        print(env_overhead(make(timestep=timestep)))
        ours, theirs = against_stock(timestep)
        print(
            f"  simulated seconds per second: ours {ours:.1f}, FetchPickAndPlace-v4 {theirs:.1f}: {ours / theirs:.1f}x"
        )


if __name__ == "__main__":
    main()
