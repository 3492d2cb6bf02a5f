"""What causalbench itself registers, through the same hooks as a stranger's plugin."""

from __future__ import annotations

from collections.abc import Callable

from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.registry import Discoverer
from causalbench.core.kinematic import make as make_kinematic
from causalbench.core.kinematic.spec import MOBILE_SPEC, SPEC
from causalbench.core.learners.methods import METHODS, Method
from causalbench.core.learners.registry import LEARNERS, Learner
from causalbench.core.tasks.mobile_manipulation import TASK as MOBILE_MANIPULATION
from causalbench.core.tasks.pure_manipulation import TASK as PURE_MANIPULATION
from causalbench.core.tasks.pure_manipulation_dense import TASK as PURE_MANIPULATION_DENSE
from causalbench.core.tasks.stack import TASK as STACK
from causalbench.core.tasks.stage_task import StageTask
from causalbench.plugins.backends import Backend, Variant
from causalbench.plugins.hookspecs import hookimpl

TASKS = (PURE_MANIPULATION, MOBILE_MANIPULATION, PURE_MANIPULATION_DENSE, STACK)


@hookimpl
def causalbench_backends(register: Callable[[Backend], None]) -> None:
    """The numpy reference backend, which is not physics, and what plays tasks over Gymnasium environments."""
    register(Backend("gymnasium", None, "the environments that tasks bring along", modules=("gymnasium",)))
    register(
        Backend(
            "kinematic",
            make_kinematic,
            "numpy, not physics",
            (
                Variant(SPEC.robot, SPEC.capabilities),
                Variant(MOBILE_SPEC.robot, MOBILE_SPEC.capabilities, {"mobile": True}),
            ),
        )
    )


@hookimpl
def causalbench_tasks(register: Callable[[StageTask], None]) -> None:
    """The paper's tasks, one with a slope where the paper's reward is sparse, and one of two boxes."""
    for task in TASKS:
        register(task)


@hookimpl
def causalbench_methods(register: Callable[[Method], None]) -> None:
    """The paper's methods."""
    for method in METHODS:
        register(method)


@hookimpl
def causalbench_learners(register: Callable[[Learner], None]) -> None:
    """One agent per stage, and stable-baselines3's own."""
    for learner in LEARNERS.values():
        register(learner)


@hookimpl
def causalbench_discoverers(register: Callable[[Discoverer], None]) -> None:
    """The paper's discovery and those it is compared with."""
    for discoverer in DISCOVERERS.values():
        register(discoverer)
