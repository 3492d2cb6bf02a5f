"""One Bullet world of its own: Fetch, a floor and the boxes of a layout, which are moved, not rebuilt, by a reset."""

from __future__ import annotations

import tempfile
import weakref
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import FOV, Box, Camera, Layout, fetch
from causalbench_pybullet.engine import pb
from causalbench_pybullet.robot import Robot

Array = NDArray[np.float64]

GRAVITY = -9.81  # m/s2
FINGER_FORCE = 20.0  # N each; at 60 N and long timesteps the fingers sink into the object
ARM_GAIN, FINGER_GAIN = 0.25, 0.2  # share of a joint's error that its motor takes out in one timestep
# Anchored: friction also corrects positions, without which a held box creeps by some tenths of a millimetre a second.
FINGER_FRICTION = {"lateralFriction": 1.5, "spinningFriction": 0.05, "rollingFriction": 0.0005, "frictionAnchor": 1}
OBJECT_FRICTION = {"lateralFriction": 1.0, "spinningFriction": 0.02, "rollingFriction": 0.0005}
GEAR_FORCE, GEAR_ERP = 500.0, 0.5  # of the constraint that keeps the fingers mirrored
UNDAMPED = {"linearDamping": 0.0, "angularDamping": 0.0}
FINGER_JOINTS = ("l_gripper_finger_joint", "r_gripper_finger_joint")
APART = 50.0  # m
OBJECT_COLOUR, OTHER_COLOUR = (0.85, 0.2, 0.1, 1.0), (0.1, 0.4, 0.8, 1.0)
NEAR, FAR = 0.05, 20.0  # m, of what a picture shows
BASE = -1  # Bullet's index of a body's first link


class Shapes(NamedTuple):
    """What a world is built for: half extents of the boxes, and the masses of the free ones, the object's first."""

    fixtures: tuple[tuple[float, ...], ...]
    objects: tuple[tuple[float, ...], ...]
    masses: tuple[float, ...]


def shapes_of(layout: Layout) -> Shapes:
    """That of `layout`."""
    fixtures, objects = (
        tuple(tuple(box.half_extents.tolist()) for box in boxes)
        for boxes in (layout.fixtures, (layout.target, *layout.others))
    )
    return Shapes(fixtures, objects, (layout.target_mass, *layout.other_masses))


class World:
    """A client of Bullet, used by nobody else, and the numbers by which it knows joints and bodies."""

    def __init__(self, robot: Robot, timestep: float, iterations: int, shapes: Shapes) -> None:
        self.shapes = shapes
        self.client: int = pb.connect(pb.DIRECT)
        self._release = weakref.finalize(self, pb.disconnect, self.client)  # also when nobody closes it
        self._at = {"physicsClientId": self.client}
        pb.setPhysicsEngineParameter(
            fixedTimeStep=timestep, numSolverIterations=iterations, numSubSteps=0, deterministicOverlappingPairs=1,
            enableFileCaching=0, **self._at,
        )  # fmt: skip
        pb.setGravity(0.0, 0.0, GRAVITY, **self._at)
        self.floor = self._box((5.0, 5.0, 0.5), 0.0, (0.45, 0.45, 0.45, 1.0))
        pb.resetBasePositionAndOrientation(self.floor, (0.0, 0.0, -0.5), (0.0, 0.0, 0.0, 1.0), **self._at)
        flags = pb.URDF_USE_INERTIA_FROM_FILE | pb.URDF_USE_SELF_COLLISION
        self.robot = int(pb.loadURDF(str(robot.urdf), useFixedBase=True, flags=flags, **self._at))
        infos = [pb.getJointInfo(self.robot, i, **self._at) for i in range(pb.getNumJoints(self.robot, **self._at))]
        joint_of = {info[1].decode(): i for i, info in enumerate(infos)}
        self.arm = [joint_of[f"{name}_joint"] for name in fetch.JOINTS]
        self.fingers = [joint_of[name] for name in FINGER_JOINTS]
        self.joints = self.arm + self.fingers
        self.links = {"base_link": BASE} | {info[12].decode(): i for i, info in enumerate(infos)}
        self.base = [self.links["base_link"], *(self.links[name] for name in robot.base_links)]
        for first, second in robot.passing:
            pb.setCollisionFilterPair(
                self.robot, self.robot, self.links[first], self.links[second], enableCollision=0, **self._at
            )
        self._drive()
        self.fixtures = [self._box(size, 0.0, (0.75, 0.7, 0.62, 1.0)) for size in shapes.fixtures]
        self.object, *self.others = (
            self._object(size, mass, OTHER_COLOUR if i else OBJECT_COLOUR)
            for i, (size, mass) in enumerate(zip(shapes.objects, shapes.masses, strict=True))
        )

    def _drive(self) -> None:
        """Rid the joints of Bullet's default damping and tie the fingers together, so that the grip stays centred."""
        for link in self.links.values():
            pb.changeDynamics(self.robot, link, jointDamping=0.0, **UNDAMPED, **self._at)
        for finger in self.fingers:
            pb.changeDynamics(self.robot, finger, **FINGER_FRICTION, **self._at)
        origin = (0.0, 0.0, 0.0)
        gear = pb.createConstraint(
            self.robot, self.fingers[0], self.robot, self.fingers[1], pb.JOINT_GEAR, (1.0, 0.0, 0.0), origin, origin,
            **self._at,
        )  # fmt: skip
        pb.changeConstraint(gear, gearRatio=-1.0, erp=GEAR_ERP, maxForce=GEAR_FORCE, **self._at)
        n = len(self.arm)
        self._forces = [*fetch.ARM_FORCE, *[FINGER_FORCE] * len(self.fingers)]
        self._gains = [ARM_GAIN] * n + [FINGER_GAIN] * len(self.fingers)
        self._zeros, self._ones = [0.0] * len(self.joints), [1.0] * len(self.joints)

    def _object(self, half_extents: tuple[float, ...], mass: float, colour: tuple[float, ...]) -> int:
        body = self._box(half_extents, mass, colour)
        pb.changeDynamics(body, BASE, **OBJECT_FRICTION, **UNDAMPED, **self._at)
        return body

    def _box(self, half_extents: tuple[float, ...], mass: float, colour: tuple[float, ...]) -> int:
        shape = pb.createCollisionShape(pb.GEOM_BOX, halfExtents=half_extents, **self._at)
        visual = pb.createVisualShape(pb.GEOM_BOX, halfExtents=half_extents, rgbaColor=colour, **self._at)
        return int(pb.createMultiBody(mass, shape, visual, **self._at))

    def place(self, layout: Layout) -> None:
        """Put base and boxes where `layout` wants them, at rest, with no memory of earlier contacts."""
        self._forget_contacts()
        x, y, yaw = layout.base_pose.tolist()
        turn = (0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))
        pb.resetBasePositionAndOrientation(self.robot, (x, y, 0.0), turn, **self._at)
        objects = self.object, *self.others
        boxes = (*layout.fixtures, layout.target, *layout.others)
        for body, box in zip((*self.fixtures, *objects), boxes, strict=True):
            self._put(body, box)
        for body in objects:
            pb.resetBaseVelocity(body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), **self._at)

    def _forget_contacts(self) -> None:
        """Part all bodies and let Bullet see it, so that nothing depends on contacts that were before."""
        for i, body in enumerate((self.robot, self.object, *self.fixtures, *self.others)):
            pb.resetBasePositionAndOrientation(body, (0.0, 0.0, APART * (i + 1)), (0.0, 0.0, 0.0, 1.0), **self._at)
        pb.performCollisionDetection(**self._at)

    def _put(self, body: int, box: Box) -> None:
        w, x, y, z = box.quaternion.tolist()
        pb.resetBasePositionAndOrientation(body, box.position.tolist(), (x, y, z, w), **self._at)

    def set_joints(self, positions: Array) -> None:
        """Put arm and fingers at `positions` (9,), at rest."""
        for joint, position in zip(self.joints, positions.tolist(), strict=True):
            pb.resetJointState(self.robot, joint, position, 0.0, **self._at)

    def joint_positions(self) -> Array:
        """Positions (9,) of arm and fingers, rad and m."""
        return np.array([state[0] for state in pb.getJointStates(self.robot, self.joints, self.client)])

    def finger_positions(self) -> tuple[float, float]:
        """Of both fingers, m."""
        left, right = pb.getJointStates(self.robot, self.fingers, self.client)
        return left[0], right[0]

    def aim(self, targets: list[float]) -> None:
        """Motor targets (9,) of arm and fingers, rad and m, until the next call."""
        pb.setJointMotorControlArray(
            self.robot, self.joints, pb.POSITION_CONTROL, targets, self._zeros, self._forces, self._gains, self._ones,
            self.client,
        )  # fmt: skip

    def advance(self, substeps: int) -> None:
        """Integrate over `substeps` timesteps."""
        step, client = pb.stepSimulation, self.client
        for _ in range(substeps):
            step(client)

    def hand(self) -> Any:
        """Position (3) and quaternion (x, y, z, w) of the last link's frame in the world."""
        return pb.getLinkState(self.robot, self.arm[-1], 0, 1, self.client)[4:6]  # with fresh kinematics, no velocity

    def object_pose(self) -> Any:
        """Position (3) and quaternion (x, y, z, w) of the object."""
        return pb.getBasePositionAndOrientation(self.object, self.client)

    def other_poses(self) -> list[Any]:
        """The same of the objects beside it."""
        return [pb.getBasePositionAndOrientation(body, self.client) for body in self.others]

    def contacts(self) -> Any:
        """Bullet's contact points of the robot: those that the last timestep was solved with."""
        return pb.getContactPoints(bodyA=self.robot, physicsClientId=self.client)

    def base_touches(self) -> bool:
        """Whether the base meets a fixture. Bullet finds no contacts between things that do not move."""
        return any(
            pb.getClosestPoints(self.robot, fixture, 0.0, linkIndexA=link, **self._at)
            for fixture in self.fixtures
            for link in self.base
        )

    def save(self) -> bytes:
        """The physical state, with the contacts' memory, but not the motors' targets."""
        with tempfile.TemporaryDirectory(prefix="causalbench-") as folder:
            path = Path(folder) / "state.bullet"
            pb.saveBullet(str(path), **self._at)
            return path.read_bytes()

    def load(self, state: bytes) -> None:
        """Return to a state of `save`, of this or of another world of equal shapes."""
        with tempfile.TemporaryDirectory(prefix="causalbench-") as folder:
            path = Path(folder) / "state.bullet"
            path.write_bytes(state)
            pb.restoreState(fileName=str(path), **self._at)

    def picture(self, width: int, height: int, camera: Camera) -> NDArray[np.uint8]:
        """RGB image (height, width, 3) of what `camera` sees, drawn without a graphics card."""
        view = pb.computeViewMatrix(camera.eye, camera.at, (0.0, 0.0, 1.0))
        lens = pb.computeProjectionMatrixFOV(FOV, width / height, NEAR, FAR)
        image = pb.getCameraImage(
            width, height, view, lens, renderer=pb.ER_TINY_RENDERER, flags=pb.ER_NO_SEGMENTATION_MASK, **self._at
        )
        return np.array(image[2], dtype=np.uint8).reshape(height, width, 4)[..., :3].copy()

    def close(self) -> None:
        """Free the world; may be called twice."""
        self._release()
