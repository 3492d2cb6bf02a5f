"""The generated robot is the one that gymnasium-robotics installs, and its cache is safe."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import mujoco
import numpy as np
import pytest

from causalbench.backend import arm_ik, fetch, rotations
from causalbench_mujoco.fetch_assets import fetch_assets
from causalbench_pybullet import robot
from causalbench_pybullet.engine import pb
from causalbench_pybullet.reading import read_poses
from causalbench_pybullet.world import Shapes, World

SHAPES = Shapes(((0.3, 0.5, 0.3),), ((0.05, 0.015, 0.025),), (0.2,))
CONFIGURATIONS = 100


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    world = World(robot.load(), 1 / 240, 20, SHAPES)
    yield world
    world.close()


@pytest.fixture(scope="module")
def stock() -> mujoco.MjModel:
    """The installed model, nothing changed."""
    return mujoco.MjModel.from_xml_path(str(fetch_assets() / "fetch" / "pick_and_place.xml"))


def joint_names(world: World) -> list[str]:
    return [pb.getJointInfo(world.robot, joint, world.client)[1].decode() for joint in world.joints]


def test_kinematics_are_those_of_the_stock_model(world: World, stock: mujoco.MjModel) -> None:
    data = mujoco.MjData(stock)
    chain = robot.load().chain
    rng = np.random.default_rng(0)
    names = joint_names(world)
    posture = {"torso_lift_joint": fetch.TORSO_HEIGHT, "head_tilt_joint": fetch.HEAD_TILT}
    for _ in range(CONFIGURATIONS):
        q = np.append(rng.uniform(-2, 2, len(world.arm)), rng.uniform(0, fetch.FINGER_STROKE, 2))
        world.set_joints(q)
        for name, value in [*zip(names, q, strict=True), *posture.items()]:
            data.joint(f"robot0:{name}").qpos = value
        mujoco.mj_kinematics(stock, data)
        base, hand = data.body("robot0:base_link"), data.body("robot0:gripper_link")
        turn = hand.xmat.reshape(3, 3)
        expected = hand.xpos + turn @ np.array(fetch.EEF_POSITION) - base.xpos
        goal = turn @ rotations.matrix(np.array(fetch.EEF_QUATERNION))
        for position, rotation in (by_engine(world), arm_ik.pose(chain, q[: len(world.arm)])):
            assert np.abs(position - expected).max() < 1e-5
            assert np.abs(rotation - goal).max() < 1e-5
        for finger in world.fingers:
            name = pb.getJointInfo(world.robot, finger, world.client)[12].decode()
            at = pb.getLinkState(world.robot, finger, computeForwardKinematics=True, physicsClientId=world.client)[4]
            assert np.abs(np.array(at) - (data.body(f"robot0:{name}").xpos - base.xpos)).max() < 1e-5


def by_engine(world: World) -> tuple[np.ndarray, np.ndarray]:
    at = read_poses(world, robot.load())
    return at[:3], rotations.matrix(at[3:7])


def test_joint_limits_are_those_of_the_stock_model(world: World, stock: mujoco.MjModel) -> None:
    for name, joint in zip(joint_names(world), world.joints, strict=True):
        low, high = pb.getJointInfo(world.robot, joint, world.client)[8:10]
        theirs = stock.joint(f"robot0:{name}")
        if stock.jnt_limited[theirs.id]:
            assert (low, high) == tuple(theirs.range)
        else:
            assert low > high  # Bullet's way to say that there is none


def test_masses_are_those_of_the_stock_model(world: World, stock: mujoco.MjModel) -> None:
    for name, link in world.links.items():
        mass = pb.getDynamicsInfo(world.robot, link, world.client)[0]
        if name == "base_link":
            continue  # does not move: Bullet gives it none
        expected = fetch.FINGER_MASS if "finger" in name else float(stock.body(f"robot0:{name}").mass[0])
        assert mass == pytest.approx(expected), name


def test_the_cache_is_filled_once_and_used_after(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made = robot.load.__wrapped__()
    assert made.urdf.is_relative_to(tmp_path)
    stamp = made.urdf.stat().st_mtime_ns
    assert robot.load.__wrapped__().urdf.stat().st_mtime_ns == stamp
    assert [path.name for path in (tmp_path / "causalbench").iterdir()] == [made.urdf.parent.name]


def test_a_cache_that_cannot_be_written_is_done_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert robot.load.__wrapped__().urdf.exists()
    assert "cannot be written" in caplog.text


def _load(_: int) -> str:
    return str(robot.load().urdf)


def test_processes_that_start_together_share_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        paths = set(pool.map(_load, range(2)))
    assert len(paths) == 1
    assert Path(paths.pop()).exists()
