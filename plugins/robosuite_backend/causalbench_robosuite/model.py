"""The MuJoCo model: robosuite's Panda, gripper, mount and table arena, put together by robosuite and then edited.

What is changed and why stands beside each edit; the README lists what it does to physics.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.core.kit import arm_ik
from causalbench.core.kit import contacts as readings
from causalbench.core.kit.environment_variables import variable_by_default
from causalbench_robosuite.engine import mujoco

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ROBOT, GRIPPER = "robot0_", "gripper0_right_"  # robosuite's prefixes
ROOT = "robot0_base"
ARM_JOINTS = tuple(f"{ROBOT}joint{i}" for i in range(1, 8))
ARM_MOTORS = tuple(f"{ROBOT}torq_j{i}" for i in range(1, 8))
FINGER_JOINTS = (f"{GRIPPER}finger_joint1", f"{GRIPPER}finger_joint2")
FINGER_SERVOS = (f"{GRIPPER}gripper_finger_joint1", f"{GRIPPER}gripper_finger_joint2")
PADS = (f"{GRIPPER}finger1_pad_collision", f"{GRIPPER}finger2_pad_collision")
GRIP_SITE = f"{GRIPPER}grip_site"
EEF_SITE = "eef"
OBJECT = "object0"

FINGER_STROKE = 0.04  # m by which each finger opens
FINGER_RANGE = (-0.015, 0.042)  # m of servo target: presses closed fingers and thin objects, and opens against friction


LIMIT_MARGIN = 0.05  # rad by which the hand's reference keeps every joint off its stops, which the law does not know


class Gains(NamedTuple):
    """robosuite's OSC_POSE: kp (6,) in 1/s2 and kd (6,) in 1/s, three for translation and three for rotation."""

    kp: Array
    kd: Array


@contextmanager
def quiet() -> Iterator[None]:
    """Hold back what robosuite does beside its work while it is imported and used.

    It logs advice on parts of it that are not used here, and sets MUJOCO_GL to "egl" for good: child processes would
    then need OpenGL to import MuJoCo.
    """
    logger = logging.getLogger("robosuite_logs")

    def only_errors(record: logging.LogRecord) -> bool:
        return record.levelno >= logging.ERROR

    logger.addFilter(only_errors)
    try:
        with variable_by_default("MUJOCO_GL", "disable"):
            yield
    finally:
        logger.removeFilter(only_errors)


@cache
def gains() -> Gains:
    """The gains of robosuite's default controller of the Panda."""
    with quiet():
        from robosuite.controllers import load_composite_controller_config

        arm = load_composite_controller_config(controller=None, robot="Panda")["body_parts"]["right"]
    kp = np.full(6, float(arm["kp"]))
    return Gains(kp, 2 * np.sqrt(kp) * float(arm["damping_ratio"]))


@cache
def stock_xml(name: str) -> str:
    """robosuite's robot `name` on its base at the origin in the table arena, as robosuite writes it."""
    with quiet():
        from robosuite.models.arenas import TableArena
        from robosuite.models.bases import robot_base_factory
        from robosuite.models.grippers import gripper_factory
        from robosuite.models.robots.robot_model import create_robot
        from robosuite.models.tasks import ManipulationTask

        robot = create_robot(name, idn=0)
        robot.add_base(robot_base_factory(robot.default_base, idn=0))
        robot.add_gripper(gripper_factory(robot.default_gripper["right"], idn="0_right"), robot.eef_name["right"])
        robot.set_base_xpos([0.0, 0.0, 0.0])
        arena = TableArena()
        arena.set_origin([0.0, 0.0, 0.0])
        xml: str = ManipulationTask(arena, [robot], []).get_xml()
    return xml


def build(timestep: float, n_fixtures: int) -> mujoco.MjModel:
    """The Panda on its mount in the world of `assemble`."""
    return assemble("Panda", timestep, n_fixtures).compile()


def assemble(robot: str, timestep: float, n_fixtures: int) -> mujoco.MjSpec:
    """A robot, a floor, one free box and `n_fixtures` static boxes `fixture0`..., all of placeholder sizes."""
    spec = mujoco.MjSpec.from_string(stock_xml(robot))
    spec.option.timestep = timestep
    # The declared inertias of hand and fingers are those of boxes a metre wide: their drag in air would be 4 N m.
    spec.option.density = spec.option.viscosity = 0.0
    _furnish(spec, n_fixtures)
    strip(spec)
    for name, sign in zip(FINGER_SERVOS, (1.0, -1.0), strict=True):
        spec.actuator(name).ctrlrange = sorted(sign * bound for bound in FINGER_RANGE)
    return spec


def strip(spec: mujoco.MjSpec) -> None:
    """Leave out what physics does not need, and add the end effector's frame.

    Masses are declared in the bodies, so geoms that touch nothing can go. The sites and sensors of the wrist are
    robosuite's observations; here nothing reads them.
    """
    for geom in list(spec.geoms):
        if geom.contype == 0 and geom.conaffinity == 0:
            spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms if geom.meshname}
    for mesh in list(spec.meshes):
        if mesh.name not in used:
            spec.delete(mesh)
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    grip = next(site for site in spec.sites if site.name == GRIP_SITE)
    half = float(np.sqrt(0.5))
    # Of the stock frame x is the closing axis; ours is y, with z, the approach axis, in common.
    grip.parent.add_site(name=EEF_SITE, pos=grip.pos, quat=[half, 0.0, 0.0, -half], group=4)


def _furnish(spec: mujoco.MjSpec, n_fixtures: int) -> None:
    """Fixtures take the contact parameters of the arena's table, which they replace."""
    table = next(geom for geom in spec.geoms if geom.name == "table_collision")
    friction, solref, solimp = list(table.friction), list(table.solref), list(table.solimp)
    spec.delete(spec.body("table"))
    for i in range(n_fixtures):
        # A body of its own: sizes and poses set later then touch one bounding volume only.
        spec.worldbody.add_body(name=f"fixture{i}").add_geom(
            name=f"fixture{i}", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1],
            friction=friction, solref=solref, solimp=solimp, rgba=[0.75, 0.7, 0.62, 1.0],
        )  # fmt: skip
    box = spec.worldbody.add_body(name=OBJECT, pos=[0.0, 0.0, 3.0])
    box.add_freejoint(name=OBJECT)
    box.add_geom(
        name=OBJECT, type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02, 0.02, 0.02], condim=4,
        friction=[1.0, 0.02, 0.001], rgba=[0.85, 0.2, 0.1, 1.0],
    )  # fmt: skip
    for geom in spec.geoms:
        geom.group = 0 if geom.group == 0 else 1  # both are drawn
        body = geom.parent.name
        geom.material = ""  # textures cost half of a picture, and collision shapes have signal colours
        if body.startswith((ROBOT, GRIPPER)):
            geom.rgba = [0.25, 0.25, 0.28, 1.0] if body.startswith(GRIPPER) else [0.9, 0.9, 0.88, 1.0]
        elif not geom.name.startswith(("fixture", OBJECT)):
            floor = geom.type == mujoco.mjtGeom.mjGEOM_PLANE
            geom.rgba = [0.4, 0.4, 0.4, 1.0] if floor else [0.6, 0.6, 0.65, 1.0]
            if floor:
                geom.size = [0.0, 0.0, 0.1]  # drawn as far as one sees; it is without end anyway


def geom_classes(model: mujoco.MjModel) -> Indices:
    """The class of every geom, (ngeom,)."""
    moving = int(model.joint(ARM_JOINTS[0]).bodyid[0])
    base = int(model.body_weldid[model.body_parentid[moving]])
    classes = np.full(model.ngeom, readings.FIXTURE)
    for i in range(model.ngeom):
        body = model.body(model.geom_bodyid[i])
        if body.name == OBJECT:
            classes[i] = readings.TARGET
        elif "finger" in body.name:
            classes[i] = (
                readings.LEFT
                if body.name in (f"{GRIPPER}leftfinger", f"{GRIPPER}finger_joint1_tip")
                else readings.RIGHT
            )
        elif body.rootid[0] == model.body(moving).rootid[0]:
            arm = body.name.startswith((ROBOT, GRIPPER)) and body.weldid[0] != base
            classes[i] = readings.ARM if arm else readings.BASE
    return classes


def arm_chain(model: mujoco.MjModel) -> arm_ik.Chain:
    """The arm from the floor under the mount to the end effector.

    The model must be as built: with the robot's root above the origin.
    """
    data, joints = mujoco.MjData(model), [model.joint(name).id for name in ARM_JOINTS]
    data.qpos[model.jnt_qposadr[joints]] = 0.0
    mujoco.mj_kinematics(model, data)
    limits = model.jnt_range[joints] + np.array([LIMIT_MARGIN, -LIMIT_MARGIN])
    hand = data.site(EEF_SITE)
    return arm_ik.chain_at_zero(data.xanchor[joints], data.xaxis[joints], limits, hand.xpos, hand.xmat.reshape(3, 3))
