"""The parts of the kit against MuJoCo's own compiler, its own stepping and the closed form of a scan."""

from __future__ import annotations

import dataclasses
import math
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest

import causalbench_mujoco
from causalbench.backend import Box, Layout, compiled, lidar, rotations
from causalbench.core.world.layout import box_rows
from causalbench_mujoco import contacts, library
from causalbench_mujoco.arms import arm_chain, closed_gap
from causalbench_mujoco.bases import FixedBase, JointBase, hold_velocity
from causalbench_mujoco.boxes import OTHER, TARGET, Boxes, add_fixtures, add_others, add_target
from causalbench_mujoco.rays import Scanner
from causalbench_mujoco.scene import squeeze

PLACEHOLDER = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="robot">
      <geom name="trunk" type="box" size="0.1 0.1 0.4" pos="0 0 0.4" mass="5"/>
      <body name="upper" pos="0 0 0.8">
        <joint name="pan" axis="0 0 1" range="-1 2"/>
        <geom name="upper" type="capsule" size="0.03" fromto="0 0 0 0.3 0 0"/>
        <body name="lower" pos="0.3 0 0">
          <joint name="bend" axis="0 1 0"/>
          <geom name="lower" type="capsule" size="0.03" fromto="0 0 0 0.2 0 0"/>
          <site name="eef" pos="0.2 0 0"/>
          <body name="left" pos="0.2 0.03 0"><geom name="left" type="box" size=".01 .005 .01" pos="0 -0.01 0"/></body>
          <body name="right" pos="0.2 -0.03 0"><geom name="right" type="box" size=".01 .005 .01"/></body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
FIXTURES = (
    Box("one", np.array([0.2, 0.3, 0.4]), np.array([1.5, 0.2, 0.4]), rotations.from_axis_angle(2, 0.4)),
    Box("two", np.array([0.1, 0.1, 1.0]), np.array([0.0, -2.0, 1.0]), UPRIGHT),
)
THING = Box("thing", np.array([0.05, 0.02, 0.03]), np.array([0.6, 0.0, 0.3]), UPRIGHT)


def layout(mass: float, *others: Box) -> Layout:
    return Layout(
        FIXTURES, THING, mass, np.zeros(3), np.zeros(3), UPRIGHT, 0.1, others=others, other_masses=(0.3,) * len(others)
    )


def model(n_fixtures: int = 2) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(PLACEHOLDER)
    add_fixtures(spec, n_fixtures)
    add_target(spec)
    spec.body(TARGET).gravcomp = 1.0  # a mark needs a model that compensates gravity at all
    return spec.compile()


def classes(of: mujoco.MjModel) -> np.ndarray:
    fixed = [of.geom(i).name.startswith("fixture") for i in range(of.ngeom)]
    return np.where(fixed, contacts.FIXTURE, contacts.ARM)


def test_the_declared_releases_are_those_that_pip_installs() -> None:
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    assert f"mujoco{causalbench_mujoco.RELEASES}" in project["dependencies"]


def test_boxes_that_are_moved_and_resized_are_those_that_the_compiler_makes() -> None:
    edited = model()
    boxes = Boxes(edited, mujoco.MjData(edited))
    boxes.place(FIXTURES)
    assert boxes.shape(layout(0.7))
    assert not boxes.shape(layout(0.7))
    spec = mujoco.MjSpec.from_string(PLACEHOLDER)
    for i, box in enumerate(FIXTURES):
        body = spec.worldbody.add_body(name=f"fixture{i}", pos=box.position, quat=box.quaternion)
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=box.half_extents)
    body = spec.worldbody.add_body(name=TARGET, pos=[0.0, 0.0, 3.0])
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=THING.half_extents, mass=0.7)
    compiled_so = spec.compile()
    for field in ("geom_size", "geom_rbound", "geom_aabb", "body_pos", "body_quat", "bvh_aabb"):
        np.testing.assert_allclose(getattr(edited, field), getattr(compiled_so, field), atol=1e-12, err_msg=field)
    inertia = edited.body(TARGET).inertia
    assert edited.body(TARGET).mass == 0.7
    np.testing.assert_allclose(sorted(inertia), sorted(compiled_so.body(TARGET).inertia), rtol=1e-9)
    assert inertia.argmax() == 1  # about y, across its longest sides: the axes are those of the box


def test_a_further_box_has_its_own_mass_place_and_class() -> None:
    spec = mujoco.MjSpec.from_string(PLACEHOLDER)
    add_fixtures(spec, 2)
    add_target(spec)
    add_others(spec, 1)
    edited = spec.compile()
    boxes = Boxes(edited, mujoco.MjData(edited))
    two = layout(0.7, dataclasses.replace(THING, half_extents=np.full(3, 0.04), position=np.array([0.1, 0.2, 0.3])))
    assert boxes.fits(two)
    assert not boxes.fits(layout(0.7))
    assert boxes.shape(two)
    boxes.put(two)
    assert (edited.body(TARGET).mass, edited.body(f"{OTHER}0").mass) == (0.7, 0.3)
    np.testing.assert_allclose(edited.body(f"{OTHER}0").inertia, 0.3 / 3 * 2 * 0.04**2)
    np.testing.assert_array_equal(boxes.other_poses[0][:3], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(boxes.pose[:3], THING.position)


@pytest.mark.parametrize(
    ("shift", "yaw", "opening", "squeezed"),
    [
        ([0.0, 0.0, 0.0], 0.0, 0.03, 0.01),  # the box is 0.04 m wide between the fingers
        ([0.0, 0.0, 0.0], 0.0, 0.05, 0.0),
        ([0.0, 0.0, 0.031], 0.0, 0.03, 0.0),  # the hand is above it
        ([0.0, 0.0, 0.0], math.pi / 2, 0.03, 0.07),
    ],
)
def test_a_start_that_is_narrower_than_the_box_in_the_hand_squeezes_it(shift, yaw, opening, squeezed) -> None:
    down = rotations.multiply(rotations.from_axis_angle(2, yaw), rotations.FACE_DOWN)
    hand = dataclasses.replace(
        layout(0.7), eef_position=THING.position + shift, eef_quaternion=down, gripper_opening=opening
    )
    assert squeeze(hand) == pytest.approx(squeezed, abs=1e-12)


@pytest.mark.parametrize("mass", [0.7, 0.0])
def test_a_mark_neither_falls_nor_touches(mass: float) -> None:
    edited = model()
    data = mujoco.MjData(edited)
    boxes = Boxes(edited, data)
    boxes.place(FIXTURES)
    boxes.shape(layout(mass))
    mujoco.mj_setConst(edited, data)
    boxes.pose[:3] = FIXTURES[0].position  # inside a fixture
    mujoco.mj_step(edited, data, 20)
    touches = bool((data.contact.geom == edited.geom(TARGET).id).any())
    moved = float(np.abs(boxes.pose[:3] - FIXTURES[0].position).max())
    assert (touches, moved > 1e-3) == (mass > 0, mass > 0)


def test_a_library_for_pictures_that_is_missing_is_named(tmp_path: Path) -> None:
    """PyOpenGL says so by an attribute of None, in the first import of MuJoCo."""
    (tmp_path / "OpenGL").mkdir()
    (tmp_path / "OpenGL" / "__init__.py").write_text("None.glGetError")
    env = os.environ | {"MUJOCO_GL": "osmesa", "PYTHONPATH": str(tmp_path)}
    env.pop("PYOPENGL_PLATFORM", None)  # which MuJoCo has set where this process has drawn a picture
    code = "import causalbench_mujoco.engine"
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
    assert done.returncode == 1
    assert "ImportError: MUJOCO_GL=osmesa: its library is not on this machine" in done.stderr


def test_a_scan_is_the_closed_form_and_sees_neither_robot_nor_target() -> None:
    edited = model()
    data = mujoco.MjData(edited)
    boxes = Boxes(edited, data)
    boxes.place(FIXTURES)
    scanner = Scanner(edited, data, classes(edited))
    boxes.pose[:3] = 0.5, 0.0, 0.3
    mujoco.mj_kinematics(edited, data)
    pose = np.array([0.05, -0.1, 0.3])
    asked = lidar.scan(box_rows(FIXTURES), lidar.scanner_pose(pose, (0.0, 0.0, 0.3)))
    found = scanner.scan(pose, (0.0, 0.0, 0.3))
    assert (asked < lidar.MAX_RANGE).sum() > 20
    np.testing.assert_allclose(found, asked, atol=1e-6)


def test_a_fixed_base_stands_where_it_is_put() -> None:
    edited = model()
    data, base = mujoco.MjData(edited), FixedBase(edited, "robot")
    base.place(np.array([1.0, -2.0, 0.7]))
    mujoco.mj_kinematics(edited, data)
    np.testing.assert_allclose(data.body("robot").xpos, [1.0, -2.0, 0.0])
    np.testing.assert_allclose(data.body("robot").xquat, [np.cos(0.35), 0.0, 0.0, np.sin(0.35)])
    np.testing.assert_array_equal(base.pose(), [1.0, -2.0, 0.7])
    np.testing.assert_array_equal(base.velocity(), [0.0, 0.0])


def driving() -> tuple[mujoco.MjModel, mujoco.MjData, JointBase]:
    spec = mujoco.MjSpec.from_string("<mujoco><worldbody><body name='base'/></worldbody></mujoco>")
    spec.option.gravity = [0.0, 0.0, 0.0]
    body = spec.body("base")
    body.add_geom(size=[0.1, 0, 0], mass=1.0)
    for name, kind, axis in (("x", "SLIDE", [1, 0, 0]), ("y", "SLIDE", [0, 1, 0]), ("yaw", "HINGE", [0, 0, 1])):
        body.add_joint(name=name, type=getattr(mujoco.mjtJoint, f"mjJNT_{kind}"), axis=axis)
        servo = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=1.0)
        hold_velocity(servo, 100.0, 1e3)
    made = spec.compile()
    data = mujoco.MjData(made)
    return made, data, JointBase(made, data, ("x", "y", "yaw"), ("x", "y", "yaw"), drives=True)


def test_a_base_that_drives_keeps_its_velocity() -> None:
    made, data, base = driving()
    base.place(np.array([1.0, 2.0, np.pi / 2]))
    base.drive(np.array([0.0, 0.5, 0.0]))
    mujoco.mj_step(made, data, 500)  # 1 s
    np.testing.assert_allclose(base.velocity(), [0.5, 0.0], atol=1e-3)  # it looks along y
    np.testing.assert_allclose(base.pose(), [1.0, 2.5, np.pi / 2], atol=0.01)


def test_the_chain_and_the_gap_are_those_of_the_model() -> None:
    made = model()
    chain = arm_chain(made, ("pan", "bend"), margin=0.1)
    np.testing.assert_allclose(chain.limits, [[-0.9, 1.9], [-np.inf, np.inf]])
    np.testing.assert_allclose(chain.offsets.sum(0), [0.5, 0.0, 0.8], atol=1e-12)
    assert closed_gap(made, ("left", "right")) == pytest.approx(0.015 + 0.025)


LEFT, RIGHT, ARM, BASE, FIXTURE, THING_CLASS = (
    contacts.LEFT, contacts.RIGHT, contacts.ARM, contacts.BASE, contacts.FIXTURE, contacts.TARGET,
)  # fmt: skip


@pytest.mark.parametrize(
    ("pairs", "flags"),
    [
        ([], (False, False, False)),
        ([(FIXTURE, BASE)], (True, False, False)),
        ([(ARM, FIXTURE)], (False, True, False)),
        ([(FIXTURE, LEFT)], (False, True, False)),
        ([(ARM, BASE)], (False, False, True)),
        ([(LEFT, RIGHT), (THING_CLASS, FIXTURE), (RIGHT, THING_CLASS), (ARM, THING_CLASS)], (False, False, False)),
    ],
)
@pytest.mark.parametrize("forces", [(6.0, 7.0), (6.0, 4.0)])
def test_flags(pairs: list[tuple[int, int]], flags: tuple[bool, ...], forces: tuple[float, float]) -> None:
    geoms = np.array(pairs, dtype=np.int32).reshape(-1, 2)  # each geom is of the class of its own number
    out, found, target = np.empty(14), np.empty(4, dtype=np.bool_), np.array([1.0, 2.0, 3.0, -2.0, 0.0, 0.0, 0.0])
    contacts.read(geoms, np.arange(6), np.array(forces), np.arange(3.0), np.eye(3).ravel(), target, out, found)
    assert tuple(found) == (*flags, min(forces) > 5.0)
    np.testing.assert_array_equal(out, [0, 1, 2, 1, 0, 0, 0, 1, 2, 3, 1, 0, 0, 0])


def test_only_the_force_along_the_closing_axis_holds() -> None:
    geoms = np.array([[LEFT, THING_CLASS], [THING_CLASS, RIGHT], [RIGHT, THING_CLASS], [ARM, THING_CLASS]], np.int32)
    frames = np.zeros((4, 9))
    frames[:, :3] = [[0, 1, 0], [0, -0.6, 0.8], [0, 0, 1], [0, 1, 0]]
    out = np.empty(2)
    forces = np.array([5.0, 10.0, 7.0, 9.0])
    contacts.pad_forces(geoms, np.arange(4, dtype=np.int32), frames, forces, np.eye(3).ravel(), np.arange(6), out)
    np.testing.assert_allclose(out, [5.0, 6.0])


@compiled
def _steps(of: int, data: int, count: int) -> None:
    for _ in range(count):
        library.mj_step1(of, data)
        library.mj_step2(of, data)


def test_the_library_is_the_one_that_mujoco_steps_with() -> None:
    made = model()
    ours, theirs = mujoco.MjData(made), mujoco.MjData(made)
    _steps(made._address, ours._address, 50)
    mujoco.mj_step(made, theirs, 50)
    assert theirs.time == pytest.approx(0.1)
    np.testing.assert_array_equal(ours.qpos, theirs.qpos)
