"""Starts, motions and measurements that several checks share.

Starts come from the layouts of a task, pure manipulation unless another is named, drawn with fixed seeds.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from causalbench.conformance.bench import expect
from causalbench.core.numerics import rotations
from causalbench.core.tasks import pure_manipulation as task
from causalbench.core.tasks import pure_manipulation_data as numbers
from causalbench.core.tasks.task import Task
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout
from causalbench.core.world.scene import ACTION_SPEED, ARM_ACTIONS, Scene
from causalbench.errors import UnreachableLayoutError

Array = NDArray[np.float64]

MAX_DRAWS = 200
POSITION_ERROR = 1e-3  # m
ANGLE_ERROR = math.radians(0.5)
AXES = ARM_ACTIONS[:-1]
ROOM = (0.1, 0.25)  # m nearer and higher: where translations start, to have room for a second of armx and armz
BEYOND = (1.1, 1.25)  # of the amount: what a pose must leave room for, translations and rotations
CLEARANCE = 0.12  # m between the table and a hand that shall touch nothing
FLAGS = ("collision_base", "collision_arm", "collision_self", "holding")
FIELDS = tuple(field.name for field in dataclasses.fields(Facts) if field.name != "extras")


def steps(scene: Scene, seconds: float) -> int:
    """How many control steps come nearest to `seconds`, at least one."""
    return max(1, round(seconds / scene.spec.control_dt))


def vector(scene: Scene, **values: float) -> Array:
    """The action with the named values, all others 0."""
    action = np.zeros(len(scene.spec.actions))
    for name, value in values.items():
        action[scene.spec.actions.index(name)] = value
    return action


def act(scene: Scene, count: int, **values: float) -> Facts:
    """Take `count` control steps of the named action values, all others 0; what holds then."""
    action = vector(scene, **values)
    for _ in range(count):
        scene.step(action)
    return scene.facts()


def draws(scene: Scene, seed: int, stage: int, of: Task = task.TASK, count: int = MAX_DRAWS) -> Iterator[Layout]:
    """`count` layouts of the task `of`; whether the arm can take them is not yet known."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield of.draw_layout(rng, scene.spec.workspace, scene.spec.max_opening, stage)


def refusal(scene: Scene, layout: Layout) -> str:
    """Reset to `layout`; "" when the scene takes it, else the reason of its `UnreachableLayoutError`."""
    try:
        scene.reset(layout)
    except UnreachableLayoutError as error:
        return str(error) or "no reason"
    return ""


def accepts(scene: Scene, layout: Layout) -> bool:
    """Reset to `layout`; False when the scene says that it cannot be."""
    return not refusal(scene, layout)


def contacts(facts: Facts) -> list[str]:
    """The flags among `FLAGS` that are set."""
    return [flag for flag in FLAGS if getattr(facts, flag)]


class Unfit:
    """Counts why layouts do not serve, for the message of a check that finds none which does."""

    def __init__(self) -> None:
        self._causes: Counter[str] = Counter()
        self._refusal = ""

    def serves(self, scene: Scene, layout: Layout) -> bool:
        """Whether `reset` accepts `layout`."""
        reason = refusal(scene, layout)
        if reason:
            self.add("refused by reset")
            self._refusal = f'. The last refusal: "{reason}"'
        return not reason

    def free(self, facts: Facts, may_hold: bool = False) -> bool:
        """Whether no flag is set, but for `holding` where that may be."""
        found = [flag for flag in contacts(facts) if not (may_hold and flag == "holding")]
        if found:
            self.add(f"with {' and '.join(found)}")
        return not found

    def add(self, cause: str) -> None:
        """Count one more."""
        self._causes[cause] += 1

    def __str__(self) -> str:
        counts = ", ".join(f"{count} {cause}" for cause, count in self._causes.most_common())
        return f"{counts}{self._refusal}. Is `spec.workspace` what the arm can reach?"


def start(scene: Scene, seed: int, stage: int = 1, of: Task = task.TASK, count: int = MAX_DRAWS) -> Layout:
    """Put the scene into the first start of `stage` that it accepts free of contact, as an environment does.

    It holds the object only in a stage of `of.held_starts`.
    """
    unfit = Unfit()
    for layout in draws(scene, seed, stage, of, count):
        if unfit.serves(scene, layout):
            facts = scene.facts()
            if unfit.free(facts, stage in of.held_starts):
                if int(of.stage(facts)) == stage:
                    return layout
                unfit.add("in another stage")
    raise AssertionError(f"no start of stage {stage} in {count} draws of {of.name} (seed {seed}): {unfit}")


def aside(scene: Scene, layout: Layout) -> Layout:
    """`layout` with the box at the side of the table that is away from the hand."""
    workspace = scene.spec.workspace
    _, hand_y, _ = to_base(layout.eef_position)
    middle = (workspace.object_low[0] + workspace.object_high[0]) / 2
    height = workspace.table_height + numbers.C.box_half_extents[2]
    place = np.array([middle, -math.copysign(0.42, hand_y), height])
    box = dataclasses.replace(layout.target, position=rotations.rotate(numbers.BASE_QUATERNION, place))
    return dataclasses.replace(layout, target=box)


def clear_poses(scene: Scene, nearer: float = 0.0, higher: float = 0.1) -> Iterator[Layout]:
    """Starts of stage 2 with the box out of the way, the hand up to so many metres `nearer` to the base and `higher`.

    The scene is asked for none of them yet.
    """
    rng = np.random.default_rng(0)
    for layout in draws(scene, 0, 2):
        shift = rotations.rotate(numbers.BASE_QUATERNION, rng.random(3) * np.array([-nearer, 0.0, higher]))
        yield aside(scene, dataclasses.replace(layout, eef_position=layout.eef_position + shift))


def clear_start(scene: Scene) -> Layout:
    """Put the scene into the first of `clear_poses` that it accepts."""
    unfit = Unfit()
    for layout in clear_poses(scene):
        if unfit.serves(scene, layout):
            return layout
    raise AssertionError(f"none of {MAX_DRAWS} poses above the table: {unfit}")


def full_runs(scene: Scene, name: str, value: float, size: float = 1.0, count: int = 5) -> list[list[Facts]]:
    """A second of one action from `count` poses: facts before it and after each of its steps.

    The poses are the first of `clear_poses` that leave room for the action at full deflection: `reset` accepts, as a
    start of its own, a pose a little beyond the one where it ends (`BEYOND`), and the arm hits nothing on its way.
    A rotation begins so that half of it leads to the middle of the tilts that the task asks for.
    """
    index, runs, unfit = AXES.index(name), [], Unfit()
    amount = value * scene.spec.action_speed[scene.spec.actions.index(name)]
    for layout in clear_poses(scene, *(ROOM if index < 3 else ())):
        if index >= 3:
            layout = _displaced(_half_tilted(layout), index, -amount / 2)
        goal = _displaced(layout, index, amount * BEYOND[index // 3])
        above = goal.eef_position[2] - scene.spec.workspace.table_height
        if above < CLEARANCE:
            unfit.add(f"would end less than {CLEARANCE} m above the table")
            continue
        if not unfit.serves(scene, goal) or not unfit.serves(scene, layout):
            continue
        run = [scene.facts()]
        for _ in range(steps(scene, 1.0)):
            run.append(act(scene, 1, **{name: value * size}))
        if all(map(unfit.free, run)):
            runs.append(run)
        if len(runs) == count:
            return runs
    raise AssertionError(
        f"only {len(runs)} of {MAX_DRAWS} poses above the table leave room for a second of {name} at {value:+g}; "
        f"{count} are needed. The others: {unfit}"
    )


def _half_tilted(layout: Layout) -> Layout:
    """`layout` with the hand half as far from straight down as the task's starts are at most."""
    posture = rotations.multiply(numbers.FACE_DOWN, rotations.from_axis_angle(1, -numbers.C.tilt_high / 2))
    return dataclasses.replace(
        layout, eef_quaternion=rotations.canonical(rotations.multiply(numbers.BASE_QUATERNION, posture))
    )


def _displaced(layout: Layout, index: int, amount: float) -> Layout:
    """`layout` with the hand moved by `amount` (m or rad) along or about `AXES[index]`."""
    if index < 3:
        shift = rotations.rotate(numbers.BASE_QUATERNION, amount * np.eye(3)[index])
        return dataclasses.replace(layout, eef_position=layout.eef_position + shift)
    turned = rotations.multiply(layout.eef_quaternion, rotations.from_axis_angle(index - 3, amount))
    return dataclasses.replace(layout, eef_quaternion=rotations.canonical(turned))


def to_base(position: Array) -> Array:
    """World coordinates (3,) seen from the base of the task's layouts."""
    return rotations.rotate(rotations.conjugate(numbers.BASE_QUATERNION), position)


def moved(before: Facts, after: Facts) -> Array:
    """(6,) translation of the hand along the base axes in m, and its rotation about its own axes in rad."""
    shift = to_base(after.eef_position - before.eef_position)
    turn = rotations.multiply(rotations.conjugate(before.eef_quaternion), after.eef_quaternion)
    return np.append(shift, rotations.rotation_vector(turn))


def grasp(scene: Scene, seed: int = 0) -> None:
    """Start with the hand around the box and close until the box is held, and a step longer."""
    start(scene, seed, 4)
    for _ in range(steps(scene, 1.5)):
        if act(scene, 1, grip=1.0).holding:
            break
    expect(act(scene, 1, grip=1.0).holding, "1.5 s of closing on a box between the fingers, but `holding` is false")


def press(scene: Scene) -> list[Facts]:
    """Drive the hand down until it is in the table and on for half a second; facts after every step."""
    height = clear_start(scene).eef_position[2] - scene.spec.workspace.table_height
    seconds = height / ACTION_SPEED["armz"] + 0.5
    return [act(scene, 1, armz=-1.0) for _ in range(steps(scene, seconds))]


def row(facts: Facts) -> Array:
    """Every number of single facts in one array."""
    values = [getattr(facts, name) for name in FIELDS] + [facts.extras[name] for name in sorted(facts.extras)]
    return np.concatenate([np.ravel(value).astype(np.float64) for value in values])


def walk(scene: Scene, seed: int, count: int = 15, size: float = 1.0, grip: bool = True) -> Array:
    """Facts (count, n) under random actions in [-size, size]; without `grip` the gripper is left alone."""
    rng, rows = np.random.default_rng(seed), []
    gripper = scene.spec.actions.index("grip")
    for _ in range(count):
        action = rng.uniform(-size, size, len(scene.spec.actions))
        action[gripper] *= grip
        scene.step(action)
        rows.append(row(scene.facts()))
    return np.array(rows)
