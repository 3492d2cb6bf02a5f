"""A two-stage toy task with a planted causal graph, over a scene that does nothing but keep the last action."""

from __future__ import annotations

import dataclasses

import numpy as np

from causalbench.core.tasks.stage_task import Term
from causalbench.core.tasks.task import Task
from causalbench.core.world.batch import Batchable, BatchScene, select
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout, Workspace
from causalbench.core.world.scene import Scene, SceneSpec

ACTIONS = ("armx", "army", "armz")
SPEC = SceneSpec(
    backend="toy",
    backend_version="1",
    engine="none",
    engine_version="1",
    robot="none",
    actions=ACTIONS,
    action_speed=(0.2, 0.2, 0.2),
    workspace=Workspace(0.0, (0.0, 0.0), (0.0, 0.0), (-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)),
    max_opening=0.1,
    control_dt=0.1,
    timestep=0.1,
    capabilities=frozenset(),
)


class ToyBatch(BatchScene):
    """The hand jumps to a random place in reset and then integrates the action."""

    def __init__(self, n: int) -> None:
        self.n, self.spec = n, SPEC
        self.hand = np.zeros((n, 3))
        self.stage = np.ones(n)
        self.layouts = {}

    def layout_of(self, index):
        return self.layouts.get(index)

    def reset(self, index, layout):
        self.layouts[index] = layout
        self.hand[index] = layout.eef_position
        self.stage[index] = layout.gripper_opening

    def step(self, actions):
        self.hand += 0.1 * actions

    def facts(self):
        no = np.zeros(self.n, dtype=bool)
        still = np.tile([1.0, 0.0, 0.0, 0.0], (self.n, 1))
        zeros = np.zeros((self.n, 3))
        return Facts(
            self.hand.copy(), still, self.stage.copy(), no, zeros, still, zeros, np.zeros((self.n, 2)), no, no, no
        )

    def snapshot(self, index):
        raise NotImplementedError

    def restore(self, index, snapshot):
        raise NotImplementedError

    def close(self):
        pass


class ToyScene(Scene, Batchable):
    """One such world. With `noise` (m) a restored hand is that far off, and "exact_restore" is missing."""

    def __init__(self, noise=0.0):
        can = SPEC.capabilities if noise else SPEC.capabilities | {"exact_restore"}
        self.spec = dataclasses.replace(SPEC, capabilities=can)
        self.noise, self.rng = noise, np.random.default_rng(0)
        self.world = ToyBatch(1)

    def batch(self, n):
        return ToyBatch(n)

    def reset(self, layout):
        self.world.reset(0, layout)
        self.layout = layout

    def step(self, action):
        self.world.step(action[None])

    def facts(self):
        return select(self.world.facts(), 0)

    def snapshot(self):
        return self.world.hand.tobytes() + self.world.stage.tobytes()

    def restore(self, snapshot):
        values = np.frombuffer(snapshot)
        self.world.hand[0] = values[:3] + self.noise * self.rng.normal(size=3)
        self.world.stage[0] = values[3]


def make_toy() -> Scene:
    return ToyScene()


def make_noisy_toy() -> Scene:
    return ToyScene(noise=0.002)


def _draw_layout(rng, workspace, max_opening, stage):
    still = np.array([1.0, 0.0, 0.0, 0.0])
    return Layout((), None, 0.0, np.zeros(3), rng.uniform(-1, 1, 3), still, float(stage))


def toy_task(rewards, n_terms: int) -> Task:
    """`rewards(previous, action, now)`, broadcasting, of a one-stage task with discoverable terms r_0, r_1, ..."""
    terms = tuple(Term(f"r_{j}", (1,), True, "") for j in range(n_terms))
    return Task(
        name="toy",
        version=0,
        env_id="causalbench/Toy-v0",
        n_stages=1,
        actions=ACTIONS,
        terms=terms,
        state_names=("x", "y", "z"),
        horizon=50,
        constants={},
        manual_graph={1: {term.name: frozenset({"armz"}) for term in terms}},
        draw_layout=_draw_layout,
        state_bounds=lambda workspace: (-2 * np.ones(3), 2 * np.ones(3)),
        observe=lambda facts: facts.eef_position,
        stage=lambda facts: np.ones(facts.gripper_opening.shape, dtype=np.int64),
        rewards=lambda previous, stage, action, now, next_stage: rewards(previous, action, now),
        success=lambda stage, now: np.zeros(now.gripper_opening.shape, dtype=bool),
        expert=lambda facts, spec, layout=None: np.zeros(3),
    )
