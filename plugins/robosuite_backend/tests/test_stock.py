"""The compiled control step is robosuite's: equal to stock `env.step`, substep for substep."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from causalbench_robosuite import control, model, structs, world

STEPS = 15  # of 0.05 s, 25 timesteps of 0.002 s each
TOLERANCE = 1e-12  # m, rad


def stock_env(uncoupled: bool) -> Any:
    """robosuite's Lift with the Panda, its default controller and its own control rate, 20 Hz."""
    with model.quiet():
        import robosuite

        config = robosuite.load_composite_controller_config(controller=None, robot="Panda")
        config["body_parts"]["right"]["uncouple_pos_ori"] = uncoupled
        env = robosuite.make(
            "Lift", robots="Panda", has_renderer=False, has_offscreen_renderer=False, use_camera_obs=False,
            control_freq=20, ignore_done=True, controller_configs=config, seed=0,
        )  # fmt: skip
        env.reset()
    return env


def new_goal(origin: Any, delta: np.ndarray, state: structs.State) -> tuple[np.ndarray, np.ndarray]:
    """The pose that the stock controller makes its goal: `delta` from the measured one, in its base frame.

    The way back through robosuite's functions, which pass rotations through single precision.
    """
    from robosuite.utils import transform_utils

    turn = transform_utils.quat2mat(transform_utils.axisangle2quat(delta[3:]))
    return state.position + origin @ delta[:3], origin @ turn @ origin.T @ state.matrix.reshape(3, 3)


@pytest.mark.parametrize("uncoupled", [True, False])
def test_the_control_step_equals_stock_stepping(uncoupled: bool) -> None:
    env = stock_env(uncoupled)
    robot, arm = env.robots[0], env.robots[0].part_controllers["right"]
    spec = mujoco.MjSpec.from_string(env.model.get_xml())
    model.strip(spec)
    twin = spec.compile()
    data = mujoco.MjData(twin)
    # Stock keeps inertia and Jacobian from before it placed the fingers; this makes it compute them anew.
    env.sim.forward()
    arm.new_update = True
    data.qpos[:], data.qvel[:] = env.sim.data.qpos, env.sim.data.qvel
    data.qacc_warmstart[:] = env.sim.data.qacc_warmstart
    mujoco.mj_step1(twin, data)

    state, addresses = world.views(twin, data), world.robot_addresses(twin)
    addresses = addresses._replace(finger_friction=0.0)  # so that the targets of resting fingers are left alone
    law = structs.Law(*model.gains(), uncoupled, np.inf, np.inf, np.inf)
    reference = structs.Reference(np.array(arm.initial_joint), np.zeros(1), np.zeros(3), np.eye(3))
    origin = np.array(arm.origin_ori)
    base = structs.Base(np.zeros(3), origin)  # stands
    gripper = np.array(robot.gripper["right"].current_action)[0]
    rng = np.random.default_rng(1)
    travelled = data.site_xpos[addresses.site].copy()
    for i in range(STEPS):
        action = rng.uniform(-0.4, 0.4, 7)
        action[6] = 1.0 if i >= 5 else -1.0
        env.step(action)
        reference.position[:], reference.rotation[:] = new_goal(origin, action[:6] * arm.output_max, state)
        gripper = np.clip(gripper - 0.2 * np.sign(action[6]), -1.0, 1.0)
        reference.finger[0] = state.ctrl[addresses.servos[0]] = 0.02 + 0.02 * gripper
        control.track(
            twin._address, data._address, 25, 0.002, base, addresses, law, reference, np.zeros(13), 0.0, state
        )  # fmt: skip
        mujoco.mj_step1(twin, data)
        assert np.abs(data.qpos - env.sim.data.qpos).max() < TOLERANCE, i
        assert np.abs(data.qvel - env.sim.data.qvel).max() < 100 * TOLERANCE, i
    assert np.linalg.norm(data.site_xpos[addresses.site] - travelled) > 0.005
