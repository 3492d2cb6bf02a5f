"""What `causalbench_pybullet` costs beside raw physics: python benchmarks/pybullet_speed.py (under a minute, one core).

Rivals take turns (A B A B ...) on the same states and actions, random actions in motion; figures are medians of
control steps. Needs an otherwise idle core.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from timing import EPISODE, STEPS, env_overhead, random_actions, timed

from causalbench.core.numerics import rotations
from causalbench.core.staged.env import StageTaskEnv
from causalbench.core.staged.scene_worlds import SceneWorlds
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench_pybullet import make
from causalbench_pybullet.engine import pb
from causalbench_pybullet.scene import PybulletScene

Array = NDArray[np.float64]


@dataclass
class Rival:
    """What is timed, and what comes before it untimed; both get the action and the final motor targets of our step."""

    run: Callable[[Array], object]
    prepare: Callable[[list[float]], object] = lambda targets: None


def compare(rivals: Callable[[StageTaskEnv], dict[str, Rival]]) -> dict[str, float]:
    """Median seconds of each rival, all from the same states, in alternating order."""
    scene = make()
    env = StageTaskEnv(SceneWorlds(TASK, scene))
    env.reset(seed=0)
    contenders = rivals(env)
    names = list(contenders)
    times: dict[str, list[float]] = {name: [] for name in names}
    for i, action in enumerate(random_actions(0, STEPS)):
        if i % EPISODE == 0:
            env.reset(seed=i)
        before = scene.snapshot()
        scene.step(action)
        after = scene.snapshot()
        scene.step(action)
        targets = bullet(env).motor_targets()
        for name in names if i % 2 else names[::-1]:
            scene.restore(before)
            scene.step(action)  # as in a run, what is timed comes after a step, not after a restore: caches are warm
            contenders[name].prepare(targets)
            times[name].append(timed(lambda rival=contenders[name], a=action: rival.run(a)))
        scene.restore(after)
    scene.close()
    return {name: statistics.median(taken) for name, taken in times.items()}


def bullet(env: StageTaskEnv) -> PybulletScene:
    """The scene below the environment."""
    assert isinstance(env.worlds.scene, PybulletScene)
    return env.worlds.scene


def against_raw(env: StageTaskEnv) -> dict[str, Rival]:
    """Step + facts; as many `stepSimulation` towards the same final targets; the same written with Bullet's own IK."""
    scene = bullet(env)
    usual = UsualWay(scene)

    def raw(_: Array) -> None:
        for _ in range(scene.substeps):
            pb.stepSimulation(scene.world.client)

    return {
        "ours": Rival(lambda a: (scene.step(a), scene.facts())),
        "raw": Rival(raw, prepare=scene.world.aim),
        "usual": Rival(usual.step),
    }


class UsualWay:
    """A control step as PyBullet's examples write it: `calculateInverseKinematics`, motors, physics, and a reading.

    The hand's pose is what it is moved from, the IK's answer goes to the motors once per control step.
    """

    def __init__(self, scene: PybulletScene) -> None:
        self.scene, self.world = scene, scene.world
        self.stride = np.array(scene.spec.action_speed) * scene.spec.control_dt
        self.hand = self.world.links["gripper_link"]
        self.opening = 0.1

    def step(self, action: Array) -> tuple[object, ...]:
        """Move the hand by the action along the base axes and about its own; what a task needs to know comes back."""
        world, client = self.world, self.world.client
        move = action * self.stride
        state = pb.getLinkState(world.robot, self.hand, computeForwardKinematics=True, physicsClientId=client)
        turned = rotations.rotate(rotations.from_axis_angle(2, np.pi / 2), move[:3])
        goal = np.array(state[4]) + turned
        turn = pb.getQuaternionFromAxisAngle((1.0, 0.0, 0.0), 0.0)
        angle = float(np.linalg.norm(move[3:6]))
        if angle > 0.0:
            turn = pb.getQuaternionFromAxisAngle((move[3:6] / angle).tolist(), angle)
        _, goal_turn = pb.multiplyTransforms((0, 0, 0), state[5], (0, 0, 0), turn)
        joints = pb.calculateInverseKinematics(
            world.robot, self.hand, goal.tolist(), goal_turn, maxNumIterations=20, physicsClientId=client
        )
        self.opening = min(max(self.opening - float(move[6]), 0.0), 0.1)
        targets = [*joints[: len(world.arm)], self.opening / 2, self.opening / 2]
        pb.setJointMotorControlArray(
            world.robot, world.joints, pb.POSITION_CONTROL, targetPositions=targets, physicsClientId=client
        )
        for _ in range(self.scene.substeps):
            pb.stepSimulation(physicsClientId=client)
        return (
            pb.getLinkState(world.robot, self.hand, computeForwardKinematics=True, physicsClientId=client),
            pb.getBasePositionAndOrientation(world.object, physicsClientId=client),
            pb.getJointStates(world.robot, world.fingers, physicsClientId=client),
            pb.getContactPoints(bodyA=world.robot, physicsClientId=client),
        )


def main() -> None:
    """Print the comparisons."""
    print("timestep 1/240 s, 20 solver iterations, control at 10 Hz")
    t = compare(against_raw)
    ours, raw, usual = (t[name] * 1e6 for name in ("ours", "raw", "usual"))
    print(f"  step + facts {ours:6.0f} us, raw stepSimulation {raw:6.0f} us: {raw / ours:.2f} of raw speed")
    print(f"  with calculateInverseKinematics instead {usual:6.0f} us: ours is {usual / ours:.2f}x as fast")
    print(env_overhead(make()))


if __name__ == "__main__":
    main()
