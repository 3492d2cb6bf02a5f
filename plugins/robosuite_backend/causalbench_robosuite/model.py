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

from causalbench.backend import variable_by_default
from causalbench_mujoco import contacts
from causalbench_mujoco.arms import HAND
from causalbench_mujoco.bases import hold_velocity
from causalbench_mujoco.boxes import OTHER, TARGET, add_fixtures, add_others, add_target
from causalbench_mujoco.engine import mujoco

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
OMRON = "mobilebase0_"  # robosuite's prefix
BASE_JOINTS = tuple(f"{OMRON}joint_mobile_{name}" for name in ("forward", "side", "yaw"))
BASE_SERVOS = tuple(f"{OMRON}actuator_mobile_{name}" for name in ("forward", "side", "yaw"))
BASE_KV = (1e4, 1e4, 3e3)  # N s / m, N m s / rad
AXIS = 0.21  # m by which the axis of turning lies behind the foot of the arm
FOOT, FIXED_FOOT = 0.70, 0.912  # m, height of the foot of the arm with the torso down, and on the fixed Panda's mount

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


def build(timestep: float, n_fixtures: int, n_others: int, drives: bool) -> mujoco.MjModel:
    """The Panda on its mount in the world of `assemble`; if it `drives`, the PandaOmron instead."""
    spec = assemble("PandaOmron" if drives else "Panda", timestep, n_fixtures, n_others)
    if drives:
        _drive_base(spec)
    return spec.compile()


def _drive_base(spec: mujoco.MjSpec) -> None:
    """The PandaOmron with its torso down, its axis of turning above the origin, its servos as stiff as a base needs."""
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # explicit damping of stiff servos diverges
    spec.body(ROOT).pos = [AXIS, 0.0, 0.0]
    spec.delete(spec.actuator(f"{OMRON}actuator_torso_height"))
    spec.delete(spec.joint(f"{OMRON}joint_torso_height"))
    spec.body(TARGET).gravcomp = 1.0  # so that the compiled model can compensate gravity at all
    for name, servo, kv in zip(BASE_JOINTS, BASE_SERVOS, BASE_KV, strict=True):
        # 250 N of dry friction along each axis of the world, whatever the heading: slow bases stop, others swerve.
        spec.joint(name).frictionloss = 0.0
        hold_velocity(spec.actuator(servo), kv)


def assemble(robot: str, timestep: float, n_fixtures: int, n_others: int = 0) -> mujoco.MjSpec:
    """A robot, a floor, the target, `n_others` free boxes and `n_fixtures` static ones, all of placeholder sizes."""
    spec = mujoco.MjSpec.from_string(stock_xml(robot))
    spec.option.timestep = timestep
    # The declared inertias of hand and fingers are those of boxes a metre wide: their drag in air would be 4 N m.
    spec.option.density = spec.option.viscosity = 0.0
    _furnish(spec, n_fixtures, n_others)
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
    grip.parent.add_site(name=HAND, pos=grip.pos, quat=[half, 0.0, 0.0, -half], group=4)


def _furnish(spec: mujoco.MjSpec, n_fixtures: int, n_others: int) -> None:
    """Fixtures take the contact parameters of the arena's table, which they replace."""
    table = next(geom for geom in spec.geoms if geom.name == "table_collision")
    friction, solref, solimp = list(table.friction), list(table.solref), list(table.solimp)
    spec.delete(spec.body("table"))
    add_fixtures(spec, n_fixtures, friction=friction, solref=solref, solimp=solimp)
    add_target(spec)
    add_others(spec, n_others)
    for geom in spec.geoms:
        geom.group = 0 if geom.group == 0 else 1  # both are drawn
        body = geom.parent.name
        geom.material = ""  # textures cost half of a picture, and collision shapes have signal colours
        if body.startswith((ROBOT, GRIPPER)):
            geom.rgba = [0.25, 0.25, 0.28, 1.0] if body.startswith(GRIPPER) else [0.9, 0.9, 0.88, 1.0]
        elif not geom.name.startswith(("fixture", TARGET, OTHER)):
            floor = geom.type == mujoco.mjtGeom.mjGEOM_PLANE
            geom.rgba = [0.4, 0.4, 0.4, 1.0] if floor else [0.6, 0.6, 0.65, 1.0]
            if floor:
                geom.size = [0.0, 0.0, 0.1]  # drawn as far as one sees; it is without end anyway


def geom_classes(model: mujoco.MjModel) -> Indices:
    """The class of every geom, (ngeom,)."""
    moving = int(model.joint(ARM_JOINTS[0]).bodyid[0])
    base = int(model.body_weldid[model.body_parentid[moving]])
    classes = np.full(model.ngeom, contacts.FIXTURE)
    for i in range(model.ngeom):
        body = model.body(model.geom_bodyid[i])
        if body.name == TARGET:
            classes[i] = contacts.TARGET
        elif body.name.startswith(OTHER):
            classes[i] = contacts.OTHER
        elif "finger" in body.name:
            classes[i] = (
                contacts.LEFT
                if body.name in (f"{GRIPPER}leftfinger", f"{GRIPPER}finger_joint1_tip")
                else contacts.RIGHT
            )
        elif body.rootid[0] == model.body(moving).rootid[0]:
            arm = body.name.startswith((ROBOT, GRIPPER)) and body.weldid[0] != base
            classes[i] = contacts.ARM if arm else contacts.BASE
    return classes
