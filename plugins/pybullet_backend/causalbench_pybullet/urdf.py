"""Writes Fetch as a URDF with convex meshes, from gymnasium-robotics' MJCF by way of MuJoCo's compiler.

Kinematics, masses and shapes are those of the compiled model. Bodies without joints are merged into the link that
carries them: what torso and head belong to is one fixed base. Only needed when the cache of `robot.py` is empty.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from causalbench.core import fetch

Array = NDArray[np.float64]

PREFIX = "robot0:"
BASE, HAND = "base_link", "gripper_link"
FINGERS = ("l_gripper_finger_link", "r_gripper_finger_link")
FIXED_JOINTS = ("torso_lift_joint", "head_pan_joint", "head_tilt_joint")
_EFFORT = 'effort="1000" velocity="10"'  # required by the format, ignored: motors have limits of their own


def write(mjcf: Path, folder: Path) -> None:
    """Write `fetch.urdf`, its meshes and `fetch.json` (what else the plugin knows of the robot) into `folder`."""
    robot = _Robot(_compile(mjcf))
    lines = ['<robot name="fetch">', *robot.links(folder), *robot.joints(), "</robot>", ""]
    (folder / "fetch.urdf").write_text("\n".join(lines))
    (folder / "fetch.json").write_text(json.dumps(robot.facts()))


def _compile(mjcf: Path) -> mujoco.MjModel:
    """The stock model with torso and head fixed, light fingers and hulls of few vertices."""
    spec = mujoco.MjSpec.from_file(str(mjcf))
    torso = spec.body(PREFIX + "torso_lift_link")
    torso.pos = np.add(torso.pos, [0.0, 0.0, fetch.TORSO_HEIGHT])
    spec.body(PREFIX + "head_tilt_link").quat = [np.cos(fetch.HEAD_TILT / 2), 0.0, np.sin(fetch.HEAD_TILT / 2), 0.0]
    for joint in FIXED_JOINTS:
        spec.delete(spec.joint(PREFIX + joint))
    for finger in FINGERS:
        body = spec.body(PREFIX + finger)
        body.mass, body.inertia, body.ipos = fetch.FINGER_MASS, [fetch.FINGER_INERTIA] * 3, [0.0, 0.0, 0.0]
    for mesh in spec.meshes:
        mesh.maxhullvert = fetch.HULL_VERTICES
    return spec.compile()


class _Robot:
    """The links of the robot, each a body with a joint, and where the bodies merged into it lie in its frame."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self.base = model.body(PREFIX + BASE).id
        self.link_of: dict[int, int] = {self.base: self.base}
        self.frame: dict[int, Array] = {self.base: np.eye(4)}  # of a body in its link
        for body in range(self.base + 1, model.nbody):
            parent = int(model.body_parentid[body])
            if parent not in self.link_of:
                continue
            if model.body_jntnum[body]:
                self.link_of[body], self.frame[body] = body, np.eye(4)
            else:
                self.link_of[body] = self.link_of[parent]
                self.frame[body] = self.frame[parent] @ _transform(model.body_pos[body], model.body_quat[body])
        self.moving = [body for body, link in self.link_of.items() if body == link != self.base]

    def name(self, body: int) -> str:
        """Name of a link or of its joint's child in the URDF."""
        return str(self.model.body(body).name).removeprefix(PREFIX)

    def joint_frame(self, link: int) -> Array:
        """The joint's frame at angle 0 in the link that carries it (4, 4). MuJoCo's `ref` is taken into account."""
        model, parent = self.model, int(self.model.body_parentid[link])
        joint = int(model.body_jntadr[link])
        if model.jnt_pos[joint].any() or model.qpos0[model.jnt_qposadr[joint]]:
            raise ValueError(f"joint of {self.name(link)}: an offset or a reference angle is not translated")
        return self.frame[parent] @ _transform(model.body_pos[link], model.body_quat[link])

    def links(self, folder: Path) -> Iterator[str]:
        """The URDF's links; writes their meshes into `folder`."""
        for link in (self.base, *self.moving):
            yield f'<link name="{self.name(link)}">{self._inertial(link)}'
            for geom in range(self.model.ngeom):
                body = int(self.model.geom_bodyid[geom])
                if self.link_of.get(body) == link:
                    yield from self._shape(geom, self.frame[body], folder)
            yield "</link>"

    def joints(self) -> Iterator[str]:
        """The URDF's joints."""
        model = self.model
        for link in self.moving:
            joint, parent = int(model.body_jntadr[link]), self.link_of[int(model.body_parentid[link])]
            low, high = model.jnt_range[joint]
            limited = model.jnt_limited[joint]
            kind = "prismatic" if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else "revolute"
            yield (
                f'<joint name="{str(model.joint(joint).name).removeprefix(PREFIX)}" '
                f'type="{kind if limited else "continuous"}"><parent link="{self.name(parent)}"/>'
                f'<child link="{self.name(link)}"/>{_origin(self.joint_frame(link))}'
                f'<axis xyz="{_numbers(model.jnt_axis[joint])}"/><limit '
                + (f'lower="{low:.17g}" upper="{high:.17g}" ' if limited else "")
                + f'{_EFFORT}/><dynamics damping="0" friction="0"/></joint>'
            )

    def facts(self) -> dict[str, object]:
        """The arm's chain for `causalbench.core.arm_ik`, the hand in the last link and the gap of closed pads."""
        model = self.model
        links = [self.link_of[model.body(f"{PREFIX}{name}_link").id] for name in fetch.JOINTS]
        hand = model.body(PREFIX + HAND).id
        frames = [self.joint_frame(link) for link in links]
        frames.append(self.frame[hand] @ _transform(np.array(fetch.EEF_POSITION), np.array(fetch.EEF_QUATERNION)))
        joints = [int(model.body_jntadr[link]) for link in links]
        limits = [model.jnt_range[joint].tolist() if model.jnt_limited[joint] else None for joint in joints]
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, frames[-1][:3, :3].ravel())
        return {
            "hand_position": frames[-1][:3, 3].tolist(),
            "hand_quaternion": [*quaternion[1:].tolist(), float(quaternion[0])],
            "rotations": [frame[:3, :3].tolist() for frame in frames],
            "offsets": [frame[:3, 3].tolist() for frame in frames],
            "axes": [model.jnt_axis[joint].tolist() for joint in joints],
            "limits": limits,
            "gap": sum(self._pad_face(finger) for finger in FINGERS),
        }

    def _pad_face(self, finger: str) -> float:
        """Distance in metres of a closed finger's inner face from the hand's middle plane."""
        body, geom = self.model.body(PREFIX + finger), self.model.geom(PREFIX + finger)
        return abs(float(body.pos[1] + geom.pos[1])) - float(geom.size[1])

    def _inertial(self, link: int) -> str:
        """Mass and inertia of all bodies of a link, its frame parallel to the link's and the products left out.

        Bullet's Jacobians are wrong for inertial frames that are turned. The base never moves: its frame is the link's,
        since Bullet places a base by its inertial frame.
        """
        model = self.model
        parts = [
            (float(model.body_mass[body]), self.frame[body] @ _transform(model.body_ipos[body], model.body_iquat[body]),
             model.body_inertia[body])
            for body, of in self.link_of.items() if of == link
        ]  # fmt: skip
        mass = sum(part[0] for part in parts)
        centre = sum((m * frame[:3, 3] for m, frame, _ in parts), np.zeros(3)) / mass
        moments = np.zeros(3)
        for m, frame, inertia in parts:
            x, y, z = (frame[:3, 3] - centre) ** 2
            moments += (frame[:3, :3] ** 2) @ inertia + m * np.array([y + z, x + z, x + y])
        at = np.eye(4)
        if link != self.base:
            at[:3, 3] = centre
        xx, yy, zz = (f"{value:.12g}" for value in moments)
        return (
            f'<inertial>{_origin(at)}<mass value="{mass:.12g}"/>'
            f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>'
        )

    def _shape(self, geom: int, body_frame: Array, folder: Path) -> Iterator[str]:
        """The collision and visual elements of a geom: a box or a mesh, which is the hull that MuJoCo collides."""
        model = self.model
        frame = body_frame @ _transform(model.geom_pos[geom], model.geom_quat[geom])
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
            shape = f'{_origin(frame)}<geometry><box size="{_numbers(2 * model.geom_size[geom])}"/></geometry>'
        else:
            name = str(model.geom(geom).name).removeprefix(PREFIX) + ".obj"
            _write_hull(model, int(model.geom_dataid[geom]), frame, folder / name)
            shape = f'{_origin(np.eye(4))}<geometry><mesh filename="{name}"/></geometry>'
        red, green, blue, _ = model.geom_rgba[geom]
        colour = f'<material name="m{geom}"><color rgba="{red:.3g} {green:.3g} {blue:.3g} 1"/></material>'
        yield f"<collision>{shape}</collision><visual>{shape}{colour}</visual>"


def _write_hull(model: mujoco.MjModel, mesh: int, frame: Array, path: Path) -> None:
    """Write the convex hull of a mesh, seen in the link, as OBJ. MuJoCo keeps it in `mesh_graph`."""
    graph = model.mesh_graph[model.mesh_graphadr[mesh] :]
    n_vertices, n_faces = int(graph[0]), int(graph[1])
    used = graph[2 + n_vertices : 2 + 2 * n_vertices]
    end = 2 + 3 * n_vertices + 3 * n_faces  # after counts, edge addresses, vertex ids and edges
    faces = np.searchsorted(np.sort(used), graph[end : end + 3 * n_faces]).reshape(-1, 3)
    points = model.mesh_vert[model.mesh_vertadr[mesh] + np.sort(used)].astype(np.float64)
    points = points @ frame[:3, :3].T + frame[:3, 3]
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = ((corners[:, 0] - points.mean(0)) * normals).sum(1) < 0
    faces[inward] = faces[inward][:, ::-1]
    lines = [f"v {_numbers(point)}" for point in points] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.write_text("\n".join(lines) + "\n")


def _transform(position: Array, quaternion: Array) -> Array:
    """Homogeneous matrix (4, 4)."""
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, quaternion)
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation.reshape(3, 3), position
    return out


def _numbers(values: Array) -> str:
    return " ".join(f"{value:.17g}" for value in values)


def _origin(frame: Array) -> str:
    """URDF's origin of a homogeneous matrix (4, 4): position, then angles about the fixed axes x, y, z."""
    r = frame[:3, :3]
    pitch = np.arctan2(-r[2, 0], np.hypot(r[0, 0], r[1, 0]))
    if np.hypot(r[0, 0], r[1, 0]) > 1e-9:
        angles = np.arctan2(r[2, 1], r[2, 2]), pitch, np.arctan2(r[1, 0], r[0, 0])
    else:  # roll and yaw turn about one axis: all of it as yaw
        angles = 0.0, pitch, np.arctan2(-r[0, 1], r[1, 1])
    return f'<origin xyz="{_numbers(frame[:3, 3])}" rpy="{_numbers(np.array(angles))}"/>'
