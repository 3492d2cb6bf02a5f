"""The MuJoCo model: MjSpec edits of the Fetch that gymnasium-robotics installs, see `causalbench_mujoco.fetch_model`.

What is changed and why stands beside each edit; the README lists what it does to physics.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import fetch
from causalbench_mujoco import contacts, fetch_model
from causalbench_mujoco.arms import HAND
from causalbench_mujoco.bases import hold_velocity
from causalbench_mujoco.boxes import OTHER, TARGET, TARGET_COLOUR, TARGET_FRICTION, add_fixtures, add_others
from causalbench_mujoco.engine import mujoco
from causalbench_mujoco.fetch_model import FINGERS

ARM_JOINTS = tuple(f"robot0:{name}_joint" for name in fetch.JOINTS)
FINGER_JOINTS = ("robot0:l_gripper_finger_joint", "robot0:r_gripper_finger_joint")
BASE_JOINTS = ("robot0:slide0", "robot0:slide1", "robot0:slide2")

ARM_KP = (4000.0, 4000.0, 3000.0, 3000.0, 1500.0, 1500.0, 800.0)  # N m / rad
ARM_KV_PER_KP = 0.04  # s: the lag of a joint behind its target
BASE_KP, BASE_KV = (1e6, 1e6, 2e5), (2.4e4, 2.4e4, 4e3)  # stiff enough to give way by under 0.1 mm
DRIVING_KV = (2e4, 2e4, 5e3)  # N s / m, N m s / rad, of a base that drives
FINGER_KP, FINGER_KV, FINGER_FORCE = 2000.0, 60.0, 60.0  # N / m, N s / m, N
FINGER_RANGE = (-0.02, 0.05)  # m; a target below 0 presses on thin objects and closed fingers on each other

ARM_LINKS = ("shoulder", "upperarm", "elbow", "forearm", "wrist", "grip")
# Collision bits. The base mesh rests in the floor, which would hold it by friction: the two share no bit.
BASE_BITS, FLOOR_BITS, ALL_BITS = 1, 2, 3


def build(timestep: float, n_fixtures: int, n_others: int, drives: bool) -> mujoco.MjModel:
    """Fetch, a floor, the target with `n_others` beside it, and `n_fixtures` static boxes; whether the base drives."""
    spec = fetch_model.load()
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # explicit damping of stiff servos diverges
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0  # with the elliptic cone: a held box does not creep
    _put_base_on_joints(spec, drives)
    _drive_arm(spec)
    _drive_fingers(spec)
    _shape_contacts(spec)
    _furnish(spec, n_fixtures, n_others)
    return spec.compile()


def _joint(spec: mujoco.MjSpec, name: str, damping: float, armature: float) -> None:
    joint = spec.joint(name)
    joint.armature, joint.stiffness, joint.frictionloss = armature, 0.0, 0.0
    # MuJoCo 3.4 and later keep polynomial coefficients here.
    joint.damping = damping if np.ndim(joint.damping) == 0 else [damping, *[0.0] * (len(joint.damping) - 1)]


def _servo(spec: mujoco.MjSpec, joint: str, kp: float, kv: float, force: float | None = None) -> mujoco.MjsActuator:
    """A position servo named after its joint; its target is an absolute joint position."""
    servo = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.set_to_position(kp=kp, kv=kv)
    if force is not None:
        servo.forcelimited, servo.forcerange = True, [-force, force]
    return servo


def _put_base_on_joints(spec: mujoco.MjSpec, drives: bool) -> None:
    """Joints x, y, yaw (the stock third slide made a hinge) at the world origin, held by stiff servos.

    Those of a base that drives hold velocities, with the force of its wheels.
    """
    spec.body("robot0:base_link").pos = [0.0, 0.0, 0.0]
    spec.joint(BASE_JOINTS[2]).type = mujoco.mjtJoint.mjJNT_HINGE
    for i, name in enumerate(BASE_JOINTS):
        _joint(spec, name, damping=1.0, armature=1.0)
        servo = _servo(spec, name, BASE_KP[i], BASE_KV[i])
        if drives:
            hold_velocity(servo, DRIVING_KV[i], fetch.BASE_FORCE[i])


def _drive_arm(spec: mujoco.MjSpec) -> None:
    """Joint servos instead of the stock mocap weld, which pushes with thousands of newtons."""
    for equality in list(spec.equalities):
        spec.delete(equality)
    spec.delete(spec.body("robot0:mocap"))
    for name, kp, force in zip(ARM_JOINTS, ARM_KP, fetch.ARM_FORCE, strict=True):
        _joint(spec, name, damping=5.0, armature=0.5)
        _servo(spec, name, kp, ARM_KV_PER_KP * kp, force)
    for body in _robot(spec):
        body.gravcomp = 1.0  # as a real arm's controller does
    hand = spec.body("robot0:gripper_link")
    hand.add_site(name=HAND, pos=fetch.EEF_POSITION, quat=fetch.EEF_QUATERNION, group=4)


def _drive_fingers(spec: mujoco.MjSpec) -> None:
    for joint, link in zip(FINGER_JOINTS, FINGERS, strict=True):
        spec.delete(spec.actuator(joint))
        _joint(spec, joint, damping=20.0, armature=1.0)  # the stock 100 kg of armature are too slow to follow
        servo = _servo(spec, joint, FINGER_KP, FINGER_KV, FINGER_FORCE)
        servo.ctrllimited, servo.ctrlrange = True, list(FINGER_RANGE)
        spec.geom(link).friction = [1.5, 0.05, 0.001]


def _robot(spec: mujoco.MjSpec) -> list[mujoco.MjsBody]:
    return [body for body in spec.bodies if body.name.startswith("robot0:")]


def is_arm(body_name: str) -> bool:
    """Whether a body of the robot belongs to the arm or the gripper; the others are base."""
    return any(word in body_name for word in ARM_LINKS)


def _shape_contacts(spec: mujoco.MjSpec) -> None:
    for body in _robot(spec):
        for geom in body.geoms:
            geom.contype = geom.conaffinity = ALL_BITS if is_arm(body.name) else BASE_BITS
            geom.margin = 0.0  # the stock millimetre would make things collide before they touch
            geom.group = 2  # drawn by default, and apart from the world for rays


def _furnish(spec: mujoco.MjSpec, n_fixtures: int, n_others: int) -> None:
    floor = spec.geom("floor0")
    floor.size, floor.pos, floor.contype, floor.conaffinity = [0, 0, 1], [0, 0, 0], FLOOR_BITS, FLOOR_BITS
    spec.delete(spec.body("floor0"))
    spec.delete(spec.body("table0"))
    add_fixtures(spec, n_fixtures, contype=ALL_BITS, conaffinity=ALL_BITS)
    _joint(spec, "object0:joint", damping=0.0, armature=0.0)
    box = spec.geom(TARGET)
    box.friction, box.condim, box.contype, box.conaffinity = TARGET_FRICTION, 4, ALL_BITS, ALL_BITS
    box.material, box.rgba = "", TARGET_COLOUR
    add_others(spec, n_others, contype=ALL_BITS, conaffinity=ALL_BITS)


def geom_classes(model: mujoco.MjModel) -> NDArray[np.int64]:
    """The class of every geom, (ngeom,)."""
    classes = np.full(model.ngeom, contacts.FIXTURE)
    for i in range(model.ngeom):
        body = model.body(model.geom_bodyid[i]).name
        if body in FINGERS:
            classes[i] = contacts.LEFT + FINGERS.index(body)
        elif body.startswith("robot0:"):
            classes[i] = contacts.ARM if is_arm(body) else contacts.BASE
        elif body == TARGET:
            classes[i] = contacts.TARGET
        elif body.startswith(OTHER):
            classes[i] = contacts.OTHER
    return classes
