"""A task whose worlds do something else with its actions than scenes do."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from causalbench.core.tasks.task import Task


@dataclass(frozen=True, kw_only=True)
class ChangedTask(Task):
    """A task whose last `idle` actions no scene executes, and whose actions are executed one step late with `lag`."""

    idle: int = 0
    lag: bool = False

    @property
    def scene_actions(self) -> tuple[str, ...]:
        """See `Task`."""
        return self.actions[: len(self.actions) - self.idle]


def as_changed(task: Task) -> ChangedTask:
    """The same task as one that can say such things."""
    if isinstance(task, ChangedTask):
        return task
    return ChangedTask(**{field.name: getattr(task, field.name) for field in dataclasses.fields(task)})
