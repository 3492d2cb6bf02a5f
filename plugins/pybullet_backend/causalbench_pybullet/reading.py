"""What is read out of Bullet after a control step: poses in the project's convention and what touches what."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.backend import HOLDING_FORCE, kernels, rotations
from causalbench_pybullet.engine import pb
from causalbench_pybullet.robot import Robot
from causalbench_pybullet.world import World

Array = NDArray[np.float64]

_BODY_B, _LINK_A, _DISTANCE, _FORCE = 2, 3, 8, 9  # places in Bullet's contact points


def read_contacts(world: World) -> tuple[bool, bool, bool, bool]:
    """Whether base and arm touch a thing and the robot itself, and whether both pads press on the object.

    Contacts count that bear force or overlap; Bullet also reports those that are about to be. Touching an object is
    no collision.
    """
    base = arm = itself = False
    forces = dict.fromkeys(world.fingers, 0.0)
    for point in world.contacts():
        other, link, force = point[_BODY_B], point[_LINK_A], point[_FORCE]
        if other == world.object:
            if link in forces:
                forces[link] += force
        elif other not in world.others and (force > 0.0 or point[_DISTANCE] <= 0.0):
            if other == world.robot:
                itself = True
            elif link in world.base:
                base = True
            else:
                arm = True
    return base, arm, itself, min(forces.values()) > HOLDING_FORCE


def read_others(world: World) -> tuple[Array, Array]:
    """Positions (n, 3) and quaternions (n, 4) of the objects beside the target."""
    poses = [(*position, w, x, y, z) for position, (x, y, z, w) in world.other_poses()]
    table = np.array(poses)
    return table[:, :3].copy(), rotations.canonical(table[:, 3:])


def read_poses(world: World, robot: Robot) -> Array:
    """Hand pose 3 + 4 and object pose 3 + 4 in the world, and the gripper's opening in metres (15,)."""
    left, right = world.finger_positions()
    out = np.empty(15)
    out[14] = left + right + robot.gap
    hand = pb.multiplyTransforms(*world.hand(), robot.hand_position, robot.hand_quaternion)
    for at, (position, (x, y, z, w)) in ((0, hand), (7, world.object_pose())):  # Bullet's order
        out[at : at + 3] = position
        kernels.canonical(w, x, y, z, out[at + 3 : at + 7])
    return out
