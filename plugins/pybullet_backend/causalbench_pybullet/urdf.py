"""Writes Fetch as a URDF with convex meshes, by way of MuJoCo's compiler.

Kinematics, masses and shapes are those of the compiled model; torso and head are fixed to the base. Only needed when
the cache of `robot.py` is empty.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import fetch
from causalbench_mujoco import fetch_model
from causalbench_mujoco.arms import closed_gap
from causalbench_mujoco.engine import mujoco
from causalbench_mujoco.fetch_model import FINGERS, PREFIX

Array = NDArray[np.float64]

BASE, HAND = "base_link", "gripper_link"
RAILS = ("base_x", "base_y", "base_yaw")  # joints of a base that drives
_EFFORT = 'effort="1000" velocity="10"'  # required by the format, ignored: motors have limits of their own


def write(folder: Path) -> None:
    """Write the robot, its meshes and `fetch.json` (what else the plugin knows of it) into `folder`.

    In `fetch.urdf` the base is the root, in `fetch-mobile.urdf` it moves on the floor on joints of its own.
    """
    robot = _Robot(fetch_model.load().compile())
    parts = [*robot.links(folder), *robot.joints()]
    for name, more in (("fetch", ()), ("fetch-mobile", _rails())):
        lines = ['<robot name="fetch">', *more, *parts, "</robot>", ""]
        (folder / f"{name}.urdf").write_text("\n".join(lines))
    (folder / "fetch.json").write_text(json.dumps(robot.facts()))


def _rails() -> Iterator[str]:
    """Links and joints x, y and yaw between a root in the world's origin and the base."""
    names = ("root", *RAILS[:-1], BASE)
    light = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
    for name in names[:-1]:
        yield f'<link name="{name}">{light}</link>'
    for i, (joint, axis) in enumerate(zip(RAILS, ("1 0 0", "0 1 0", "0 0 1"), strict=True)):
        kind, limits = ("continuous", "") if i == 2 else ("prismatic", 'lower="-100" upper="100" ')
        yield (
            f'<joint name="{joint}" type="{kind}"><parent link="{names[i]}"/><child link="{names[i + 1]}"/>'
            f'<axis xyz="{axis}"/><limit {limits}{_EFFORT}/></joint>'
        )


class _Robot:
    """The links of the robot: its bodies that have mass, on joints or fixed.

    Fixed bodies stay links of their own: what Bullet saves of contacts is exact for links of one shape only.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self.base = model.body(PREFIX + BASE).id
        self.bodies = [self.base]
        for body in range(self.base + 1, model.nbody):
            if model.body_mass[body] and int(model.body_parentid[body]) in self.bodies:
                self.bodies.append(body)

    def name(self, body: int) -> str:
        """Name of a link in the URDF."""
        return str(self.model.body(body).name).removeprefix(PREFIX)

    def parent(self, link: int) -> int:
        """The link that carries a link."""
        return int(self.model.body_parentid[link])

    def part(self, link: int) -> int:
        """The first link of the rigid part that a link belongs to."""
        while link != self.base and not self.model.body_jntnum[link]:
            link = self.parent(link)
        return link

    def frame(self, link: int) -> Array:
        """A link's frame at joint position 0 in the link that carries it (4, 4)."""
        model = self.model
        if model.body_jntnum[link]:
            joint = int(model.body_jntadr[link])
            if model.jnt_pos[joint].any() or model.qpos0[model.jnt_qposadr[joint]]:
                raise ValueError(f"joint of {self.name(link)}: an offset or a reference angle is not translated")
        return _transform(model.body_pos[link], model.body_quat[link])

    def links(self, folder: Path) -> Iterator[str]:
        """The URDF's links; writes their meshes into `folder`."""
        for link in self.bodies:
            shapes = [self._shape(int(geom), folder) for geom in np.flatnonzero(self.model.geom_bodyid == link)]
            yield f'<link name="{self.name(link)}">{self._inertial(link)}{"".join(shapes)}</link>'

    def joints(self) -> Iterator[str]:
        """The URDF's joints."""
        model = self.model
        for link in self.bodies[1:]:
            kind, name, motion = "fixed", f"{self.name(link)}_fixed", ""
            if model.body_jntnum[link]:
                joint = int(model.body_jntadr[link])
                name = str(model.joint(joint).name).removeprefix(PREFIX)
                limits = ""
                kind = "prismatic" if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else "revolute"
                if model.jnt_limited[joint]:
                    low, high = model.jnt_range[joint]
                    limits = f'lower="{low:.17g}" upper="{high:.17g}" '
                else:
                    kind = "continuous"
                motion = f'<axis xyz="{_numbers(model.jnt_axis[joint])}"/><limit {limits}{_EFFORT}/>'
            yield (
                f'<joint name="{name}" type="{kind}"><parent link="{self.name(self.parent(link))}"/>'
                f'<child link="{self.name(link)}"/>{_origin(self.frame(link))}{motion}</joint>'
            )

    def facts(self) -> dict[str, object]:
        """What the plugin needs beside the URDF, for `robot.py`."""
        model = self.model
        links = [model.body(f"{PREFIX}{name}_link").id for name in fetch.JOINTS]
        hand = model.body(PREFIX + HAND).id
        eef = _transform(np.array(fetch.EEF_POSITION), np.array(fetch.EEF_QUATERNION))
        frames = [self._between(link, self.part(self.parent(link))) for link in links]
        frames.append(self._between(hand, links[-1]) @ eef)
        joints = [int(model.body_jntadr[link]) for link in links]
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, frames[-1][:3, :3].ravel())
        return {
            "rotations": [frame[:3, :3].tolist() for frame in frames],
            "offsets": [frame[:3, 3].tolist() for frame in frames],
            "axes": [model.jnt_axis[joint].tolist() for joint in joints],
            "limits": [model.jnt_range[joint].tolist() if model.jnt_limited[joint] else None for joint in joints],
            "hand_position": frames[-1][:3, 3].tolist(),
            "hand_quaternion": [*quaternion[1:].tolist(), float(quaternion[0])],
            "gap": closed_gap(model, FINGERS),
            "base_links": [self.name(link) for link in self.bodies[1:] if self.part(link) == self.base],
            "passing": [[self.name(a), self.name(b)] for a, b in self._passing()],
        }

    def _between(self, link: int, ancestor: int) -> Array:
        """Frame of `link` in `ancestor` (4, 4), all joints at 0."""
        out = np.eye(4)
        while link != ancestor:
            out = self.frame(link) @ out
            link = self.parent(link)
        return out

    def _passing(self) -> Iterator[tuple[int, int]]:
        """Links that never collide, as in MuJoCo: those of one rigid part, and of two that share a joint."""
        for a, b in combinations(self.bodies, 2):
            first, second = self.part(a), self.part(b)
            if first in (second, self._carrier(second)) or second == self._carrier(first):
                yield a, b

    def _carrier(self, part: int) -> int:
        """The rigid part that carries a rigid part; of the base itself."""
        return self.base if part == self.base else self.part(self.parent(part))

    def _inertial(self, link: int) -> str:
        """Mass and inertia of a link, its inertial frame parallel to the link's and the products left out.

        Bullet's Jacobians are wrong for inertial frames that are turned. The base never moves: its frame is the link's,
        since Bullet places a base by its inertial frame.
        """
        model = self.model
        inertia = _transform(model.body_ipos[link], model.body_iquat[link])
        xx, yy, zz = (f"{value:.12g}" for value in (inertia[:3, :3] ** 2) @ model.body_inertia[link])
        at = np.eye(4)
        if link != self.base:
            at[:3, 3] = inertia[:3, 3]
        return (
            f'<inertial>{_origin(at)}<mass value="{model.body_mass[link]:.12g}"/>'
            f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>'
        )

    def _shape(self, geom: int, folder: Path) -> str:
        """The collision and visual elements of a geom: a box or a mesh, which is the hull that MuJoCo collides."""
        model = self.model
        frame = _transform(model.geom_pos[geom], model.geom_quat[geom])
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
            shape = f'{_origin(frame)}<geometry><box size="{_numbers(2 * model.geom_size[geom])}"/></geometry>'
        else:
            name = str(model.geom(geom).name).removeprefix(PREFIX) + ".obj"
            _write_hull(model, int(model.geom_dataid[geom]), frame, folder / name)
            shape = f'{_origin(np.eye(4))}<geometry><mesh filename="{name}"/></geometry>'
        red, green, blue, _ = model.geom_rgba[geom]
        colour = f'<material name="m{geom}"><color rgba="{red:.3g} {green:.3g} {blue:.3g} 1"/></material>'
        return f"<collision>{shape}</collision><visual>{shape}{colour}</visual>"


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
