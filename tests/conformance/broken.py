"""Kinematic scenes, each wrong in one way: `BROKEN` maps a number of the contract to the backend that breaks it."""

from __future__ import annotations

import dataclasses
import functools
import math
import multiprocessing
import os
import threading
from typing import Any, ClassVar

import numpy as np
from conformance import hasty
from numpy.typing import NDArray

from causalbench.core.kinematic import make
from causalbench.core.kinematic.mobile import BASE_HIT, MobileWorlds
from causalbench.core.kinematic.scenes import WorldsScene
from causalbench.core.kinematic.spec import MOBILE_SPEC, SPEC
from causalbench.core.kinematic.worlds import BASE_POSE, BOX, BOX_HALF, COMMAND, HAND, TABLE_HIT, KinematicWorlds
from causalbench.core.world import lidar
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout
from causalbench.core.world.scene import Array, SceneSpec, check_action
from causalbench.errors import SnapshotError, UnreachableLayoutError
from causalbench.plugins.backends import Backend, Variant

NAMES = SPEC.actions


class Altered(WorldsScene):
    """A kinematic scene with another spec, facts changed on their way out, and five numbers of state of its own."""

    worlds_type: ClassVar[type[KinematicWorlds]] = KinematicWorlds
    changes: ClassVar[dict[str, Any]] = {}

    def __init__(self) -> None:
        super().__init__(self.worlds_type(()))
        self.spec = dataclasses.replace(self.spec, **self.changes)
        self.own = np.zeros(5)

    @property
    def state(self) -> Array:
        return self.worlds.state

    def reset(self, layout: Layout) -> None:
        super().reset(layout)
        self.own[:] = 0.0

    def facts(self) -> Facts:
        facts = super().facts()
        return dataclasses.replace(facts, **self.alter(facts))

    def alter(self, facts: Facts) -> dict[str, Any]:
        return {}

    def snapshot(self) -> bytes:
        return self.own.tobytes() + super().snapshot()

    def restore(self, snapshot: bytes) -> None:
        super().restore(snapshot[self.own.nbytes :])
        self.own[:] = np.frombuffer(snapshot[: self.own.nbytes])


class AlteredMobile(Altered):
    """The same of the hand on a base that drives."""

    worlds_type = MobileWorlds
    worlds: MobileWorlds


def held(scene: Altered) -> bool:
    return bool(scene.worlds.facts().holding)


class Nameless(Altered):
    changes: ClassVar = {"engine_version": ""}


class Reordered(Altered):
    changes: ClassVar = {"actions": NAMES[::-1], "action_speed": SPEC.action_speed[::-1]}

    def step(self, action: Array) -> None:
        super().step(action[::-1])


class FlatWorkspace(Altered):
    changes: ClassVar = {
        "workspace": dataclasses.replace(SPEC.workspace, object_low=(0.64, -0.15), object_high=(0.64, 0.15))
    }


class WideWorkspace(Altered):
    """Two hands out of three shall start where the arm does not reach."""

    changes: ClassVar = {
        "workspace": dataclasses.replace(SPEC.workspace, hand_high=(1.5, 0.2, SPEC.workspace.hand_high[2]))
    }


class FarWorkspace(Altered):
    """No hand can start where it shall."""

    changes: ClassVar = {
        "workspace": dataclasses.replace(SPEC.workspace, hand_low=(3.0, -0.2, 0.75), hand_high=(3.1, 0.2, 1.0))
    }


class BrokenTime(Altered):
    changes: ClassVar = {"timestep": 0.03}


class Boastful(Altered):
    changes: ClassVar = {"capabilities": SPEC.capabilities | {"teleport"}}


class IntegerFlag(Altered):
    def alter(self, facts: Facts) -> dict[str, Any]:
        return {"collision_base": np.int64(0)}


class OtherSign(Altered):
    def alter(self, facts: Facts) -> dict[str, Any]:
        return {"object_quaternion": -facts.object_quaternion}


class Views(Altered):
    def __init__(self) -> None:
        super().__init__()
        self.velocity = np.zeros(2)

    def alter(self, facts: Facts) -> dict[str, Any]:
        return {"base_velocity": self.velocity}


class OffLayout(Altered):
    def reset(self, layout: Layout) -> None:
        super().reset(layout)
        self.state[BOX.start] += 2e-3


class FixedYaw(Altered):
    def alter(self, facts: Facts) -> dict[str, Any]:
        return {"base_pose": np.append(facts.base_pose[:2], math.pi / 2)}


class ReachesAll(Altered):
    def reset(self, layout: Layout) -> None:
        try:
            super().reset(layout)
        except UnreachableLayoutError:
            if np.linalg.norm(layout.eef_position) < 2:
                raise


class StartsInContact(Altered):
    """Starts at one side of the table touch something until the first step."""

    def reset(self, layout: Layout) -> None:
        super().reset(layout)
        self.own[0] = self.state[HAND.start + 1] > 0.15

    def step(self, action: Array) -> None:
        super().step(action)
        self.own[0] = 0.0

    def alter(self, facts: Facts) -> dict[str, Any]:
        return {"collision_self": np.bool_(self.own[0] > 0)}


class Scaled(Altered):
    """Every action times its entry of `scale`."""

    scale: ClassVar[Array]

    def step(self, action: Array) -> None:
        super().step(check_action(action, (7,)) * self.scale)


class SlowArmx(Scaled):
    scale = np.array([0.8, 1, 1, 1, 1, 1, 1])


class InvertedArmrz(Scaled):
    scale = np.array([1, 1, 1, 1, 1, -1, 1])


class SlowGrip(Scaled):
    scale = np.array([1, 1, 1, 1, 1, 1, 0.8])


class SlowTurn(AlteredMobile):
    """Turns slowly on the spot, and does not say so."""

    def step(self, action: Array) -> None:
        action = check_action(action, (9,)).copy()
        self.own[0] = 0.0
        if action[1] and not action[0]:
            self.own[0] = 0.2 * action[1] * MOBILE_SPEC.action_speed[1]
            action[1] *= 0.8
        super().step(action)

    def alter(self, facts: Facts) -> dict[str, Any]:
        return {"base_velocity": facts.base_velocity + np.array([0.0, self.own[0]])}


class Progressive(Altered):
    def step(self, action: Array) -> None:
        action = check_action(action, (7,)).copy()
        action[:3] *= np.sqrt(np.abs(action[:3]))
        super().step(action)


class Stutters(Altered):
    """Nothing on one step, two control steps on the next."""

    def step(self, action: Array) -> None:
        check_action(action, (7,))
        self.own[0] = 1 - self.own[0]
        if self.own[0] == 0:
            super().step(action)
            super().step(action)


class Sinks(Altered):
    def step(self, action: Array) -> None:
        super().step(action)
        if not action.any():
            self.state[HAND.start + 2] -= 1e-4


class Creeps(Altered):
    def step(self, action: Array) -> None:
        super().step(action)
        if action[6] == 0 and not held(self):
            self.state[COMMAND] = min(self.state[COMMAND] + 1e-4, SPEC.max_opening)


class Falling(Altered):
    """A free box falls onto the table or the floor, and a hand near the base touches it; right in every way."""

    gravity = 9.81
    near = 0.3  # m
    changes: ClassVar = {"capabilities": SPEC.capabilities | {"physics"}}

    def reset(self, layout: Layout) -> None:
        super().reset(layout)
        table = layout.fixtures[0]
        self.own[:] = 0.0, *table.position[:2], *table.half_extents[:2]

    def alter(self, facts: Facts) -> dict[str, Any]:
        way = facts.eef_position[:2] - facts.base_pose[:2]
        return {"collision_self": np.bool_(np.linalg.norm(way) < self.near)}

    def step(self, action: Array) -> None:
        super().step(action)
        facts = self.worlds.facts()
        if facts.holding:
            self.own[0] = 0.0
            return
        x, y = facts.object_position[:2] - self.own[1:3]
        over = abs(x) < self.own[4] and abs(y) < self.own[3]  # the base is turned by a quarter
        support = 0.025 + SPEC.workspace.table_height * over
        self.own[0] -= self.gravity * SPEC.control_dt
        height = self.state[BOX.start + 2] + self.own[0] * SPEC.control_dt
        if height < support:
            height, self.own[0] = support, 0.0
        self.state[BOX.start + 2] = height


class NeverTouchesItself(Falling):
    def alter(self, facts: Facts) -> dict[str, Any]:
        return {}


class LightBox(Falling):
    gravity = 4.9


class TakesNaN(Altered):
    def step(self, action: Array) -> None:
        super().step(np.where(np.isnan(action), 0.0, action))


class BlowsUp(Altered):
    def step(self, action: Array) -> None:
        super().step(action)
        self.own[0] += 1

    def alter(self, facts: Facts) -> dict[str, Any]:
        return {"eef_position": facts.eef_position * np.nan} if self.own[0] > 150 else {}


class NoCollisions(Altered):
    def alter(self, facts: Facts) -> dict[str, Any]:
        return {"collision_arm": np.bool_(False)}


class FalseCollisions(Altered):
    """Small motions of the arm report that the robot touches itself."""

    def step(self, action: Array) -> None:
        super().step(action)
        size = np.abs(action[:6])
        self.own[0] = ((size > 0) & (size < 0.4)).any()

    def alter(self, facts: Facts) -> dict[str, Any]:
        return {"collision_self": np.bool_(self.own[0] > 0)}


class HoldsNothing(Altered):
    def alter(self, facts: Facts) -> dict[str, Any]:
        empty = self.state[COMMAND] < 0.01 and not len(facts.other_positions)
        return {"holding": np.bool_(facts.holding | empty)}


class Remembers(Altered):
    """Every reset starts a little further on."""

    def __init__(self) -> None:
        super().__init__()
        self.resets = 0

    def reset(self, layout: Layout) -> None:
        super().reset(layout)
        self.resets += 1
        self.state[HAND.start] += 1e-9 * self.resets


class OtherInEachProcess(Altered):
    def reset(self, layout: Layout) -> None:
        super().reset(layout)
        self.state[HAND.start] += 1e-11 * os.getpid()


class Shared(Altered):
    """What was reset last disturbs every other scene."""

    owner: ClassVar[Any] = None

    def reset(self, layout: Layout) -> None:
        super().reset(layout)
        Shared.owner = self

    def restore(self, snapshot: bytes) -> None:
        super().restore(snapshot)
        Shared.owner = self

    def step(self, action: Array) -> None:
        super().step(action)
        if Shared.owner is not self:
            self.state[HAND.start] += 1e-6


class LosesMotion(Altered):
    def restore(self, snapshot: bytes) -> None:
        super().restore(snapshot)
        if not held(self) and not self.state[TABLE_HIT]:
            self.state[HAND.start] += 1e-9


class Inexact(LosesMotion):
    """What it loses it declares; right in every way."""

    changes: ClassVar = {"capabilities": SPEC.capabilities - {"exact_restore"}, "restore_error": 1e-8}


class LosesContact(Altered):
    def restore(self, snapshot: bytes) -> None:
        super().restore(snapshot)
        self.state[TABLE_HIT] = 0.0


class LosesGrasp(Altered):
    def restore(self, snapshot: bytes) -> None:
        super().restore(snapshot)
        if held(self):
            self.state[COMMAND] = 0.03


class OwnBytesOnly(Altered):
    """Bytes of another process come back a little off."""

    def snapshot(self) -> bytes:
        self.own[4] = os.getpid()
        return super().snapshot()

    def restore(self, snapshot: bytes) -> None:
        super().restore(snapshot)
        if self.own[4] != os.getpid():
            self.state[HAND.start] += 1e-9


class TakesAnyBytes(Altered):
    def restore(self, snapshot: bytes) -> None:
        try:
            super().restore(snapshot)
        except SnapshotError:
            return


class ClosesOnce(Altered):
    closed = False

    def close(self) -> None:
        if self.closed:
            raise RuntimeError("no such scene")
        self.closed = True


class NoChild(Altered):
    def __init__(self) -> None:
        super().__init__()
        if multiprocessing.parent_process() is not None:
            raise RuntimeError("no display")


class OneTurnAtATime(Altered):
    """Two rotations at once cancel each other."""

    def step(self, action: Array) -> None:
        action = check_action(action, (7,)).copy()
        if action[3] and action[4]:
            action[3:5] = 0.0
        super().step(action)


class Slippery(Altered):
    """A held box stays behind when it is lifted."""

    def step(self, action: Array) -> None:
        box = self.state[BOX].copy()
        lifting = held(self) and action[2] > 0
        super().step(action)
        if lifting:
            self.state[BOX] = box


class MarkOnBase(AlteredMobile):
    """A target of mass 0 rides along."""

    def alter(self, facts: Facts) -> dict[str, Any]:
        mark = not self.state[BOX_HALF].any()
        shift = 0.03 * (self.state[BASE_POSE] - self.own[:3]) * mark
        return {"object_position": facts.object_position + np.append(shift[:2] + shift[2], 0.0)}

    def reset(self, layout: Layout) -> None:
        super().reset(layout)
        self.own[:3] = layout.base_pose


class LeavesHandBehind(AlteredMobile):
    """An arc takes the hand off its place on the base; forward or turn alone does not."""

    def step(self, action: Array) -> None:
        super().step(action)
        if action[0] and action[1] and not action[2:].any():
            self.state[HAND.start] -= 2e-3


class NoVelocity(AlteredMobile):
    def alter(self, facts: Facts) -> dict[str, Any]:
        return {"base_velocity": np.zeros(2)}


class StaleScan(AlteredMobile):
    """Scans from where the base was at the start."""

    def reset(self, layout: Layout) -> None:
        super().reset(layout)
        self.own[:3] = layout.base_pose

    def lidar(self) -> Array:
        return lidar.scan(self.worlds.boxes, lidar.scanner_pose(self.own[:3], lidar.POSITION))


class SeesTheTarget(AlteredMobile):
    def lidar(self) -> Array:
        pose = lidar.scanner_pose(self.state[BASE_POSE], lidar.POSITION)
        facts = self.worlds.facts()
        row = np.concatenate([np.full(3, 0.05), facts.object_position, facts.object_quaternion])
        return np.minimum(super().lidar(), lidar.scan(row[None], pose))


class NoBaseCollision(AlteredMobile):
    def alter(self, facts: Facts) -> dict[str, Any]:
        return {"collision_base": np.bool_(False)}


class LosesBaseContact(AlteredMobile):
    def restore(self, snapshot: bytes) -> None:
        super().restore(snapshot)
        self.worlds.base[BASE_HIT] = 0.0


class Stalls(AlteredMobile):
    """Stalls for good after a long way forward."""

    def step(self, action: Array) -> None:
        action = check_action(action, (9,)).copy()
        self.own[0] += action[0] > 0.6
        action[0] *= self.own[0] <= 12
        super().step(action)


class OldPicture(Altered):
    """Shows what the first picture showed."""

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        self.drawn = getattr(self, "drawn", {})
        return self.drawn.setdefault((width, height), super().render(width, height, camera)).copy()


class LosesOthers(Altered):
    """Boxes beside the target fall out of the hand."""

    def step(self, action: Array) -> None:
        others = self.worlds.others.copy()
        super().step(action)
        self.worlds.others = others


class Copyable(Altered):
    """A copy is a scene like any other, as if Python saw all of its state."""

    def __reduce_ex__(self, protocol: Any) -> Any:
        return object.__reduce_ex__(self, protocol)


class OneThread(Altered):
    """Draws in the thread that has drawn first alone, as OpenGL does."""

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        self.thread = getattr(self, "thread", threading.get_ident())
        if self.thread != threading.get_ident():
            raise RuntimeError("the context is current in another thread")
        return super().render(width, height, camera)


class OneProcess(Altered):
    """Draws in the process that has drawn first alone, and shows nothing in another."""

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        self.process = getattr(self, "process", os.getpid())
        return super().render(width, height, camera) * (self.process == os.getpid())


class Misplaced(Altered):
    """The hand is 28 mm nearer to the base than facts say."""

    off = 0.028

    def reset(self, layout: Layout) -> None:
        super().reset(layout)
        self.state[HAND.start] -= self.off

    def alter(self, facts: Facts) -> dict[str, Any]:
        yaw = facts.base_pose[2]
        return {"eef_position": facts.eef_position + self.off * np.array([math.cos(yaw), math.sin(yaw), 0.0])}


class Higher(Misplaced):
    """The hand is 5 cm lower than facts say."""

    def reset(self, layout: Layout) -> None:
        Altered.reset(self, dataclasses.replace(layout, eef_position=layout.eef_position - UP))
        self.layout = layout

    def alter(self, facts: Facts) -> dict[str, Any]:
        return {"eef_position": facts.eef_position + UP}


UP = np.array([0.0, 0.0, 0.05])


def backend(make: Any, spec: SceneSpec = SPEC, modules: tuple[str, ...] = ()) -> Backend:
    capabilities = getattr(make, "changes", {}).get("capabilities", spec.capabilities)
    return Backend(spec.backend, make, spec.engine, (Variant(spec.robot, capabilities),), modules)


BROKEN = {
    "S1": backend(Nameless),
    "S2": backend(Reordered),
    "S3": backend(FlatWorkspace),
    "S4": backend(BrokenTime),
    "S5": backend(Boastful),
    "S6": backend(IntegerFlag),
    "S7": backend(OtherSign),
    "S8": backend(Views),
    "S9": backend(OffLayout),
    "S10": backend(FixedYaw),
    "S11": backend(ReachesAll),
    "S12": backend(StartsInContact),
    "S13": backend(SlowArmx),
    "S14": backend(InvertedArmrz),
    "S15": backend(SlowGrip),
    "S16": backend(SlowTurn, MOBILE_SPEC),
    "S17": backend(Progressive),
    "S18": backend(Stutters),
    "S19": backend(Sinks),
    "S20": backend(Creeps),
    "S21": backend(LightBox),
    "S22": backend(TakesNaN),
    "S23": backend(BlowsUp),
    "S24": backend(NoCollisions),
    "S25": backend(FalseCollisions),
    "S26": backend(HoldsNothing),
    "S27": backend(Remembers),
    "S28": backend(OtherInEachProcess),
    "S29": backend(Shared),
    "S30": backend(LosesMotion),
    "S31": backend(LosesContact),
    "S32": backend(LosesGrasp),
    "S33": backend(OwnBytesOnly),
    "S34": backend(TakesAnyBytes),
    "S35": backend(ClosesOnce),
    "S36": backend(hasty.make, modules=("conformance.pretend_simulator",)),
    "S37": backend(NoChild),
    "S38": backend(OneTurnAtATime),
    "S39": backend(Slippery),
    "S40": backend(MarkOnBase, MOBILE_SPEC),
    "S41": backend(LeavesHandBehind, MOBILE_SPEC),
    "S42": backend(NoVelocity, MOBILE_SPEC),
    "S43": backend(StaleScan, MOBILE_SPEC),
    "S44": backend(SeesTheTarget, MOBILE_SPEC),
    "S45": backend(NoBaseCollision, MOBILE_SPEC),
    "S46": backend(LosesBaseContact, MOBILE_SPEC),
    "S47": backend(Stalls, MOBILE_SPEC),
    "S48": backend(OldPicture),
    "S49": backend(LosesOthers),
    "S50": backend(Copyable),
    "S51": backend(OneThread),
    "S52": backend(OneProcess),
    "S53": backend(Misplaced),
    "S54": backend(NeverTouchesItself),
}
MOBILE_NUMBERS = {"S16", *(f"S{i}" for i in range(40, 48))}
INTACT = {
    "kinematic": (backend(make), MOBILE_NUMBERS | {"S21", "S54"}),
    "mobile": (backend(functools.partial(make, mobile=True), MOBILE_SPEC), {"S21", "S54"}),
    "falling": (backend(Falling), MOBILE_NUMBERS),
    "inexact": (backend(Inexact), MOBILE_NUMBERS | {"S21", "S54"}),
}
"""Name -> a backend without a fault, and the numbers that do not apply to it."""
