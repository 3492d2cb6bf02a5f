"""What a simulator must offer: one `Scene`, ten members. Everything else in core is built on it.

Units and frames, once for all backends: metres, radians, seconds; world frame with z up; quaternions
(w, x, y, z), unit, w >= 0; the end-effector frame has z along the approach
axis (out of the palm), y along the finger closing axis and its origin between the finger pads; the
robot base frame has x forward, y left, z up, origin on the floor.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NoReturn, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from causalbench.core.world.capabilities import Capability
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout, Workspace
from causalbench.errors import CausalbenchError, InvalidActionError

Array = NDArray[np.float64]

ACTION_SPEED: Mapping[str, float] = {
    "forward": 0.6,  # m/s of the base at |a| = 1
    "turn": 1.2,  # rad/s of the base
    "armx": 0.2,  # m/s of the end effector along the base axes
    "army": 0.2,
    "armz": 0.2,
    "armrx": 0.8,  # rad/s of the end effector about its own axes
    "armry": 0.8,
    "armrz": 0.8,
    "grip": 0.2,  # m/s by which the distance between the finger pads shrinks
}
"""Every macro action in the project's order, with its default speed at full deflection."""
BASE_ACTIONS = ("forward", "turn")
ARM_ACTIONS = tuple(name for name in ACTION_SPEED if name not in BASE_ACTIONS)
"""Those of a robot that drives, and those of its arm and gripper, which every robot has."""


@dataclass(frozen=True)
class SceneSpec:
    """What a scene is and can do. Two scenes with equal specs accept each other's snapshots.

    `actions` are the names the scene supports, in the order of `ACTION_SPEED`; `action_speed` is the
    declared speed of each at |a| = 1 in m/s or rad/s; `max_opening` the distance between open finger pads
    in metres; `control_dt` and `timestep` are seconds; `capabilities` are some of `SCENE_CAPABILITIES`. Without
    `EXACT_RESTORE`, `restore_error` says how far any number in facts may be off in 15 steps after a restore.
    `lidar_position` is where the scanner sits in the base frame, metres. `engine_settings` are numbers beside the
    timestep that the engine was set to and that change what it computes, such as `{"solver_iterations": 20}`.
    """

    backend: str
    backend_version: str
    engine: str
    engine_version: str
    robot: str
    actions: tuple[str, ...]
    action_speed: tuple[float, ...]
    workspace: Workspace
    max_opening: float
    control_dt: float
    timestep: float
    capabilities: frozenset[Capability]
    restore_error: float = 0.0
    lidar_position: tuple[float, float, float] | None = None
    engine_settings: Mapping[str, float] = field(default_factory=dict)

    @property
    def engine_text(self) -> str:
        """The engine, its version and its settings for people and records: "Bullet 3.2.7, 20 solver iterations"."""
        settings = (f"{value} {name.replace('_', ' ')}" for name, value in self.engine_settings.items())
        return ", ".join([f"{self.engine} {self.engine_version}", *settings])


class Scene(ABC):
    """One simulated world with one robot. Not thread-safe; several may live in one process.

    `layout` is the start of the world as it is now, which `reset` was given or a restored snapshot came from, and None
    before: the map that an expert may plan on, and the named numbers that go into its facts.

    Copying and pickling raise `CausalbenchError`: a simulator keeps state that Python does not see.
    """

    spec: SceneSpec
    layout: Layout | None = None

    @abstractmethod
    def reset(self, layout: Layout) -> None:
        """Put the world into `layout`, at rest.

        Raises `UnreachableLayoutError` when the arm cannot take the pose or the start is not at rest because things
        overlap: the caller draws another layout, and may ask for facts in between. Calls `check_layout` first, which
        refuses what the scene has no capability for.
        """

    @abstractmethod
    def step(self, action: Array) -> None:
        """Advance by exactly one `spec.control_dt`.

        `action` has shape (len(spec.actions),), each in [-1, 1]; 0 means that this dimension is not
        executed: the hand keeps its pose, the gripper its opening and force. Raises `InvalidActionError`.
        """

    @abstractmethod
    def facts(self) -> Facts:
        """What holds now; no batch dimensions."""

    @abstractmethod
    def snapshot(self) -> bytes:
        """The whole simulator state: physics, controllers and layout."""

    @abstractmethod
    def restore(self, snapshot: bytes) -> None:
        """Return to a snapshot made by any scene of an equal spec, also in another process.

        With the capability `EXACT_RESTORE` every later step is bit-identical to the first time, else
        within `spec.restore_error`.
        Raises `SnapshotError`.
        """

    def render(self, width: int, height: int, camera: str = "scene") -> NDArray[np.uint8]:
        """RGB image (height, width, 3), the caller's own; needs the capability `RGB`.

        `cameras.find_camera` knows where the camera stands. Drawing changes nothing in the world, and nothing that
        draws is imported before the first picture. Raises `UnknownNameError` for a camera that does not exist and
        `CausalbenchError` where what draws is missing on this machine.
        """
        raise lacking(self.spec, Capability.RGB)

    def lidar(self) -> Array:
        """Ranges (220,) float64 in metres, from right to left; needs the capability `LIDAR`.

        Level rays from `spec.lidar_position` at `lidar.ANGLES` from straight ahead (paper, appendix A). They meet
        fixtures, not the robot and no free object; `lidar.MAX_RANGE` where they meet none.
        """
        raise lacking(self.spec, Capability.LIDAR)

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        raise not_copied(self.spec)

    def close(self) -> None:  # noqa: B027 - optional; a scene without resources has nothing to release
        """Release what the scene holds; may be called twice."""


def not_copied(spec: SceneSpec) -> CausalbenchError:
    """The error of a scene or a batch that is copied or pickled: Python does not see a simulator's state."""
    return CausalbenchError(
        f"a scene of backend {spec.backend!r} cannot be copied or pickled: make another one and give its restore() "
        "what snapshot() of this one returns"
    )


def lacking(spec: SceneSpec, capability: Capability) -> CausalbenchError:
    """The error to raise where a scene of `spec` is asked for what needs `capability`."""
    return CausalbenchError(f"backend {spec.backend!r} has no capability {capability!r}")


def check_layout(layout: Layout, spec: SceneSpec) -> None:
    """Raise `CausalbenchError` if `layout` has objects that a scene with `spec` cannot have."""
    if layout.others and Capability.SEVERAL_OBJECTS not in spec.capabilities:
        names = ", ".join(box.name for box in layout.others)
        raise CausalbenchError(
            f"the layout has objects beside the target ({names}), and backend {spec.backend!r} has no capability "
            f"{Capability.SEVERAL_OBJECTS!r}"
        )


def check_action(action: Array, shape: tuple[int, ...]) -> Array:
    """Return `action` as float64 of `shape`. Raises `InvalidActionError`, which says what is wrong with it."""
    try:
        action = np.asarray(action).astype(np.float64, casting="same_kind", copy=False)
    except (TypeError, ValueError) as error:
        raise InvalidActionError(f"action {action!r} is no array of numbers: {error}") from error
    if action.shape != shape:
        raise InvalidActionError(f"action has shape {action.shape}, expected {shape}")
    if not (abs(action) <= 1.0 + 1e-6).all():  # also catches NaN
        raise InvalidActionError(f"action {action} is not finite or leaves [-1, 1]")
    return action
