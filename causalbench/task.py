"""An author of a task imports this module alone. `examples/a_task` is a worked example."""

from causalbench.core.numerics import rotations
from causalbench.core.tasks import pure_manipulation
from causalbench.core.tasks.gym_task import GymTask, Seen
from causalbench.core.tasks.lift_and_hold import lift_and_hold
from causalbench.core.tasks.stage_task import CausalSets, StageTask, Term, by_name, causal_sets
from causalbench.core.tasks.stages import active_terms, staged_potential
from causalbench.core.tasks.task import Expert, Task
from causalbench.core.world.capabilities import Capability
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Box, Layout, Workspace
from causalbench.core.world.scene import SceneSpec
from causalbench.plugins.hookspecs import hookimpl

__all__ = [
    "Box",
    "Capability",
    "CausalSets",
    "Expert",
    "Facts",
    "GymTask",
    "Layout",
    "SceneSpec",
    "Seen",
    "StageTask",
    "Task",
    "Term",
    "Workspace",
    "active_terms",
    "by_name",
    "causal_sets",
    "hookimpl",
    "lift_and_hold",
    "pure_manipulation",
    "staged_potential",
    "rotations",
]
