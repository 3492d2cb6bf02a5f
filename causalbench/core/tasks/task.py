"""What a task over scenes is: its data and pure functions over `Facts`, single or with one batch dimension."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from causalbench.core.tasks.stage_task import StageTask
from causalbench.core.world.capabilities import Capability
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout, Workspace
from causalbench.core.world.lidar import N_SECTORS
from causalbench.core.world.scene import Scene, SceneSpec
from causalbench.errors import UserError

Array = NDArray[np.float64]

OBSERVABLE = frozenset({"gripper", "lidar"})
"""What a task may declare as part of every observation beside the state."""


class Expert(Protocol):
    """A scripted policy: it returns the macro action (..., n_actions) that leads on, and proves a task solvable.

    `layout` is the map it may plan on, one a world where `facts` are of several; without it, it takes the world for
    empty.
    """

    def __call__(self, facts: Facts, spec: SceneSpec, layout: Layout | Sequence[Layout] | None = None) -> Array:
        """A pure function, like all else of a task."""


@dataclass(frozen=True, kw_only=True)
class Task(StageTask):
    """A staged task over scenes. It declares everything that it needs of the world. All functions are pure.

    Numbers that differ from start to start, such as the height of the table or a place to put things, `draw_layout`
    names in `Layout.extras`; every other function then finds them in `Facts.extras`.

    - `draw_layout(rng, workspace, max_opening, stage)`: a start inside `stage`, up to the caller's check of U(s);
    - `state_bounds(workspace)`: (low, high), each (n_state,) float64: where the state variables normally lie;
    - `observe(facts)`: state variables (..., n_state) in the paper's order, robot base frame;
    - `stage(facts)`: the paper's U(s), int (...), 1 to n_stages; memoryless, so it can go back;
    - `success(stage, now)`: bool (...), `stage` being U(s) before the step;
    - `rewards(previous, stage, action, now, next_stage)`: (..., n_terms), terms that are not active in `stage` =
      U(previous) are 0;
    - `expert`: see `Expert`;
    - `requires`: capabilities of a scene without which the task cannot run;
    - `scene_options`: options of a backend's `make` that the task needs, such as `{"mobile": True}`;
    - `camera`: the one that shows people what happens, see `cameras.find_camera`;
    - `observes`: what is part of every observation beside the state, some of `OBSERVABLE`;
    - `after_success(scene)`: what a success is put to, such as lifting what was grasped, and whether it stood it; None
      where nothing follows. It steps the scene;
    - `held_starts`: stages whose starts may hold the object; elsewhere a start that holds it is drawn again.
    """

    draw_layout: Callable[[np.random.Generator, Workspace, float, int], Layout]
    state_bounds: Callable[[Workspace], tuple[Array, Array]]
    observe: Callable[[Facts], Array]
    stage: Callable[[Facts], NDArray[np.int64]]
    success: Callable[[NDArray[np.int64], Facts], NDArray[np.bool_]]
    rewards: Callable[[Facts, NDArray[np.int64], Array, Facts, NDArray[np.int64]], Array]
    expert: Expert
    requires: frozenset[Capability] = frozenset()
    scene_options: Mapping[str, Any] = field(default_factory=dict)
    camera: str = "scene"
    observes: frozenset[str] = frozenset()
    after_success: Callable[[Scene], bool] | None = None
    held_starts: frozenset[int] = frozenset()

    def __post_init__(self) -> None:
        super().__post_init__()
        if unknown := self.observes - OBSERVABLE:
            raise UserError(f"task {self.name!r}: observes: {sorted(unknown)} are none of {sorted(OBSERVABLE)}")
        if "lidar" in self.observes and Capability.LIDAR not in self.requires:
            raise UserError(f"task {self.name!r} observes the lidar, so `requires` must name Capability.LIDAR")

    @property
    def scene_actions(self) -> tuple[str, ...]:
        """The actions that a scene executes, the first of `actions`."""
        return self.actions

    def input_names(self, features: bool, sectors: bool = False) -> tuple[str, ...]:
        """The state variables, since rewards may depend on it how far the gripper is open, features and sectors."""
        seen = tuple(f"sector_{k}" for k in range(N_SECTORS)) if sectors else ()
        return (*self.state_names, "gripper_opening", *(self.feature_names if features else ()), *seen)
