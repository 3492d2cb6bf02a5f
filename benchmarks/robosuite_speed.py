"""What `causalbench_robosuite` costs beside raw physics: python benchmarks/robosuite_speed.py (half a minute).

Rivals take turns (A B A B ...) on the same states and actions, random actions in motion; figures are medians of
control steps or of turns. Needs an otherwise idle core.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from causalbench.core.env import StageTaskEnv
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench_robosuite import make, model
from causalbench_robosuite.scene import RobosuiteScene

Array = NDArray[np.float64]

STEPS = 300  # control steps per comparison
SEGMENT = 20  # control steps per turn against the stock environment
TURNS = 12


def timed(work: Callable[[], object]) -> float:
    """Seconds that one call takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def random_actions(seed: int, count: int) -> Array:
    """Random walk actions (count, 7): each is held for five steps, so that the arm really travels."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1, 1, (count // 5 + 1, len(TASK.actions))), 5, axis=0)[:count]


def torques(scene: RobosuiteScene, action: Array) -> Array:
    """The commands (1, substeps, nu) of about this control step, found by taking it one substep at a time."""
    delta, commands = action * np.array(scene.spec.action_speed) * scene.spec.timestep, []
    for _ in range(scene.substeps):
        scene._run(delta, 1, 1)
        commands.append(scene.data.ctrl.copy())
    return np.array([commands])


def against_raw() -> tuple[float, float]:
    """Median seconds of step + facts and of the raw `mj_step`s of the same substeps on the same model.

    From one snapshot each control step runs through the scene and, in alternating order, as a replay of recorded
    torques by MuJoCo's own loop over `mj_step`, `mujoco.rollout`.
    """
    scene = make()
    env = StageTaskEnv(TASK, scene)
    assert isinstance(scene, RobosuiteScene)
    ours, raw = [], []
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    for i, action in enumerate(random_actions(0, STEPS)):
        if i % 50 == 0:
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


def env_against_scene() -> tuple[float, float]:
    """Median seconds of `StageTaskEnv.step` and of the bare scene's step + facts, same states and actions."""
    scene = make()
    env = StageTaskEnv(TASK, scene)
    with_env, bare = [], []
    for i, action in enumerate(random_actions(1, STEPS)):
        if i % 50 == 0:
            env.reset(seed=i)
        before = scene.snapshot()
        for rival in ("env", "bare") if i % 2 else ("bare", "env"):
            scene.restore(before)
            if rival == "env":
                with_env.append(timed(lambda a=action: env.step(a)))
            else:
                bare.append(timed(lambda a=action: (scene.step(a), scene.facts())))
    return statistics.median(with_env), statistics.median(bare)


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
    env, stock = StageTaskEnv(TASK, make()), stock_env()
    rng = np.random.default_rng(2)
    ours, theirs = [], []
    for turn in range(TURNS):
        env.reset(seed=turn)
        stock.reset()
        actions = random_actions(turn, SEGMENT)
        stock_actions = np.repeat(rng.uniform(-0.4, 0.4, (SEGMENT // 5, 7)), 5, axis=0)
        taken = timed(lambda a=actions: [env.step(action) for action in a])
        ours.append(SEGMENT * env.scene.spec.control_dt / taken)
        taken = timed(lambda a=stock_actions: [stock.step(action) for action in a])
        theirs.append(SEGMENT * stock.control_timestep / taken)
    return statistics.median(ours), statistics.median(theirs)


def main() -> None:
    """Print the three comparisons."""
    print("physics timestep 0.002 s, control at 10 Hz (stock: 20 Hz)")
    ours, raw = against_raw()
    print(f"  step + facts {ours * 1e6:6.0f} us, raw mj_step {raw * 1e6:6.0f} us: {raw / ours:.2f} of raw speed")
    with_env, bare = env_against_scene()
    print(f"  StageTaskEnv {with_env * 1e6:6.0f} us, scene       {bare * 1e6:6.0f} us: {with_env / bare - 1:+.1%}")
    ours, theirs = against_stock()
    print(f"  simulated seconds per second: ours {ours:.2f}, robosuite's Lift {theirs:.2f}: {ours / theirs:.1f}x")


if __name__ == "__main__":
    main()
