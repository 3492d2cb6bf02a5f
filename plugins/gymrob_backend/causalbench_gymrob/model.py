"""The MuJoCo model: MjSpec edits of the Fetch assets that gymnasium-robotics installs. No robot file is shipped.

What is changed and why stands beside each edit; the README lists what it does to physics.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from causalbench.core.kit import arm_ik
from causalbench.core.kit import contacts as readings
from causalbench.core.kit.robots import fetch
from causalbench_gymrob.engine import mujoco

ARM_JOINTS = tuple(f"robot0:{name}_joint" for name in fetch.JOINTS)
FINGERS = ("robot0:l_gripper_finger_link", "robot0:r_gripper_finger_link")
FINGER_JOINTS = ("robot0:l_gripper_finger_joint", "robot0:r_gripper_finger_joint")
BASE_JOINTS = ("robot0:slide0", "robot0:slide1", "robot0:slide2")
EEF_SITE = "eef"
OBJECT = "object0"

ARM_KP = (4000.0, 4000.0, 3000.0, 3000.0, 1500.0, 1500.0, 800.0)  # N m / rad
ARM_KV_PER_KP = 0.04  # s: the lag of a joint behind its target
ARM_FORCE = (150.0, 150.0, 100.0, 100.0, 60.0, 60.0, 40.0)  # N m
BASE_KP, BASE_KV = (1e6, 1e6, 2e5), (2.4e4, 2.4e4, 4e3)  # stiff enough to give way by under 0.1 mm
FINGER_KP, FINGER_KV, FINGER_FORCE = 2000.0, 60.0, 60.0  # N / m, N s / m, N
FINGER_RANGE = (-0.02, 0.05)  # m; a target below 0 presses on thin objects and closed fingers on each other

ARM_LINKS = ("shoulder", "upperarm", "elbow", "forearm", "wrist", "grip")
# Collision bits. The base mesh rests in the floor, which would hold it by friction: the two share no bit.
BASE_BITS, FLOOR_BITS, ALL_BITS = 1, 2, 3


def assets() -> Path:
    """Folder of the installed Fetch assets. Looked up without the import, which prints warnings and costs a second."""
    spec = find_spec("gymnasium_robotics")
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError("gymnasium_robotics is not installed")
    return Path(spec.origin).parent / "envs" / "assets" / "fetch"


def build(timestep: float, n_fixtures: int) -> mujoco.MjModel:
    """Fetch, a floor, one free box and `n_fixtures` static boxes `fixture0`..., all of placeholder sizes."""
    spec = mujoco.MjSpec.from_file(str(assets() / "pick_and_place.xml"))
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # explicit damping of stiff servos diverges
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0  # with the elliptic cone: a held box does not creep
    _fix_head_and_torso(spec)
    _drive_base(spec)
    _drive_arm(spec)
    _drive_fingers(spec)
    _shape_contacts(spec)
    _furnish(spec, n_fixtures)
    return spec.compile()


def _fix_head_and_torso(spec: mujoco.MjSpec) -> None:
    """No action moves them, so they cost no degrees of freedom."""
    torso = spec.body("robot0:torso_lift_link")
    torso.pos = np.add(torso.pos, [0.0, 0.0, fetch.TORSO_HEIGHT])
    spec.body("robot0:head_tilt_link").quat = [np.cos(fetch.HEAD_TILT / 2), 0.0, np.sin(fetch.HEAD_TILT / 2), 0.0]
    for name in ("robot0:torso_lift_joint", "robot0:head_pan_joint", "robot0:head_tilt_joint"):
        spec.delete(spec.joint(name))


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


def _drive_base(spec: mujoco.MjSpec) -> None:
    """Joints x, y, yaw (the stock third slide made a hinge) at the world origin, held by stiff servos."""
    spec.body("robot0:base_link").pos = [0.0, 0.0, 0.0]
    spec.joint(BASE_JOINTS[2]).type = mujoco.mjtJoint.mjJNT_HINGE
    for name, kp, kv in zip(BASE_JOINTS, BASE_KP, BASE_KV, strict=True):
        _joint(spec, name, damping=1.0, armature=1.0)
        _servo(spec, name, kp, kv)


def _drive_arm(spec: mujoco.MjSpec) -> None:
    """Joint servos instead of the stock mocap weld, which pushes with thousands of newtons."""
    for equality in list(spec.equalities):
        spec.delete(equality)
    spec.delete(spec.body("robot0:mocap"))
    for name, kp, force in zip(ARM_JOINTS, ARM_KP, ARM_FORCE, strict=True):
        _joint(spec, name, damping=5.0, armature=0.5)
        _servo(spec, name, kp, ARM_KV_PER_KP * kp, force)
    for body in _robot(spec):
        body.gravcomp = 1.0  # as a real arm's controller does
    hand = spec.body("robot0:gripper_link")
    hand.add_site(name=EEF_SITE, pos=fetch.EEF_POSITION, quat=fetch.EEF_QUATERNION, group=4)


def _drive_fingers(spec: mujoco.MjSpec) -> None:
    for joint, link in zip(FINGER_JOINTS, FINGERS, strict=True):
        spec.delete(spec.actuator(joint))
        # Stock fingers weigh 4 kg with 100 kg of armature: too slow to follow and too heavy for the wrist.
        _joint(spec, joint, damping=20.0, armature=1.0)
        body = spec.body(link)
        body.mass, body.inertia, body.ipos = fetch.FINGER_MASS, [fetch.FINGER_INERTIA] * 3, [0.0, 0.0, 0.0]
        servo = _servo(spec, joint, FINGER_KP, FINGER_KV, FINGER_FORCE)
        servo.ctrllimited, servo.ctrlrange = True, list(FINGER_RANGE)
        spec.geom(link).friction = [1.5, 0.05, 0.001]


def _robot(spec: mujoco.MjSpec) -> list[mujoco.MjsBody]:
    return [body for body in spec.bodies if body.name.startswith("robot0:")]


def is_arm(body_name: str) -> bool:
    """Whether a body of the robot belongs to the arm or the gripper; the others are base."""
    return any(word in body_name for word in ARM_LINKS)


def _shape_contacts(spec: mujoco.MjSpec) -> None:
    for mesh in spec.meshes:
        mesh.maxhullvert = fetch.HULL_VERTICES
    for body in _robot(spec):
        for geom in body.geoms:
            geom.contype = geom.conaffinity = ALL_BITS if is_arm(body.name) else BASE_BITS
            geom.margin = 0.0  # the stock millimetre would make things collide before they touch
            geom.group = 2  # drawn by default, and apart from the world for rays


def _furnish(spec: mujoco.MjSpec, n_fixtures: int) -> None:
    floor = spec.geom("floor0")
    floor.size, floor.pos, floor.contype, floor.conaffinity = [0, 0, 1], [0, 0, 0], FLOOR_BITS, FLOOR_BITS
    spec.delete(spec.body("floor0"))
    spec.delete(spec.body("table0"))
    for i in range(n_fixtures):
        # A body of its own: sizes and poses set later then touch one bounding volume only.
        spec.worldbody.add_body(name=f"fixture{i}").add_geom(
            name=f"fixture{i}", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1],
            contype=ALL_BITS, conaffinity=ALL_BITS, rgba=[0.75, 0.7, 0.62, 1.0],
        )  # fmt: skip
    _joint(spec, "object0:joint", damping=0.0, armature=0.0)
    box = spec.geom(OBJECT)
    box.friction, box.condim, box.contype, box.conaffinity = [1.0, 0.02, 0.001], 4, ALL_BITS, ALL_BITS
    box.material, box.rgba = "", [0.85, 0.2, 0.1, 1.0]


def geom_classes(model: mujoco.MjModel) -> NDArray[np.int64]:
    """The class of every geom, (ngeom,)."""
    classes = np.full(model.ngeom, readings.FIXTURE)
    for i in range(model.ngeom):
        body = model.body(model.geom_bodyid[i]).name
        if body in FINGERS:
            classes[i] = readings.LEFT + FINGERS.index(body)
        elif body.startswith("robot0:"):
            classes[i] = readings.ARM if is_arm(body) else readings.BASE
        elif body == OBJECT:
            classes[i] = readings.TARGET
    return classes


def arm_chain(model: mujoco.MjModel) -> arm_ik.Chain:
    """The arm from the base link to the end effector, in the base frame."""
    data, joints = mujoco.MjData(model), [model.joint(name).id for name in ARM_JOINTS]
    data.qpos[model.jnt_qposadr[joints]] = 0.0
    mujoco.mj_kinematics(model, data)
    limits = np.where(model.jnt_limited[joints, None], model.jnt_range[joints], [-np.inf, np.inf])
    hand = data.site(EEF_SITE)
    return arm_ik.chain_at_zero(data.xanchor[joints], data.xaxis[joints], limits, hand.xpos, hand.xmat.reshape(3, 3))
