"""What `causalbench_robosuite` costs beside raw physics: python benchmarks/robosuite_speed.py (half a minute).

Rivals take turns (A B A B ...) on the same states and actions, random actions in motion; figures are medians of
control steps or of turns. Needs an otherwise idle core.
"""

from __future__ import annotations

import statistics
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray
from timing import EPISODE, STEPS, env_overhead, random_actions, timed

from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench_robosuite import make, model
from causalbench_robosuite.scene import RobosuiteScene

Array = NDArray[np.float64]

SEGMENT = 20  # control steps per turn against the stock environment
TURNS = 12


def torques(scene: RobosuiteScene, action: Array) -> Array:
    """The commands (1, substeps, nu) of about this control step, found by taking it one substep at a time."""
    delta, commands = action * np.array(scene.spec.action_speed) * scene.spec.timestep, []
    for _ in range(scene.substeps):
        scene.advance(delta, 1, 1)
        commands.append(scene.data.ctrl.copy())
    return np.array([commands])


def against_raw() -> tuple[float, float]:
    """Median seconds of step + facts and of the raw `mj_step`s of the same substeps on the same model.

    From one snapshot each control step runs through the scene and, in alternating order, as a replay of recorded
    torques by MuJoCo's own loop over `mj_step`, `mujoco.rollout`.
    """
    scene = make()
    env = StageTaskEnv(SceneWorlds(TASK, scene))
    assert isinstance(scene, RobosuiteScene)
    ours, raw = [], []
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    for i, action in enumerate(random_actions(0, STEPS)):
        if i % EPISODE == 0:
            env.reset(seed=i)
            start = np.empty((1, mujoco.mj_stateSize(scene.model, kind)))
        before = scene.snapshot()
        mujoco.mj_getState(scene.model, scene.data, start[0], kind)
        commands = torques(scene, action)
        for rival in ("ours", "raw") if i % 2 else ("raw", "ours"):
            scene.restore(before)
            if rival == "ours":
                ours.append(timed(lambda a=action: (scene.step(a), scene.facts())))
                after = scene.snapshot()
            else:
                raw.append(timed(lambda s=start, c=commands: rollout.rollout(scene.model, scene.data, s, c)))
        scene.restore(after)
    return statistics.median(ours), statistics.median(raw)


def stock_env() -> Any:
    """robosuite's Lift: the same robot, gripper and arena, a cube instead of the box, without pictures."""
    with model.quiet():
        import robosuite

        return robosuite.make(
            "Lift", robots="Panda", has_renderer=False, has_offscreen_renderer=False, use_camera_obs=False,
            control_freq=20, ignore_done=True, hard_reset=False, seed=0,
        )  # fmt: skip


def against_stock() -> tuple[float, float]:
    """Simulated seconds per second of our environment and of the stock one, medians over turns."""
    env, stock = StageTaskEnv(SceneWorlds(TASK, make())), stock_env()
    rng = np.random.default_rng(2)
    ours, theirs = [], []
    for turn in range(TURNS):
        env.reset(seed=turn)
        stock.reset()
        actions = random_actions(turn, SEGMENT)
        stock_actions = np.repeat(rng.uniform(-0.4, 0.4, (SEGMENT // 5, 7)), 5, axis=0)
        taken = timed(lambda a=actions: [env.step(action) for action in a])
        ours.append(SEGMENT * env.worlds.scene.spec.control_dt / taken)
        taken = timed(lambda a=stock_actions: [stock.step(action) for action in a])
        theirs.append(SEGMENT * stock.control_timestep / taken)
    return statistics.median(ours), statistics.median(theirs)


def main() -> None:
    """Print the three comparisons."""
    print("physics timestep 0.002 s, control at 10 Hz (stock: 20 Hz)")
    ours, raw = against_raw()
    print(f"  step + facts {ours * 1e6:6.0f} us, raw mj_step {raw * 1e6:6.0f} us: {raw / ours:.2f} of raw speed")
    print(env_overhead(make()))
    ours, theirs = against_stock()
    print(f"  simulated seconds per second: ours {ours:.2f}, robosuite's Lift {theirs:.2f}: {ours / theirs:.1f}x")


if __name__ == "__main__":
    main()
