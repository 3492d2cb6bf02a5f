"""One number from a reward vector: what going back and forth earns, beside what the expert earns."""

import importlib.util
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from causalbench.core.kinematic import make
from causalbench.core.learners.scalars import FirstEntry, make_scalar
from causalbench.core.staged.scene_worlds import make_scene_worlds
from causalbench.core.staged.vector_env import StageTaskVectorEnv
from causalbench.core.tasks.mobile_manipulation import TASK as MOBILE
from causalbench.core.tasks.pure_manipulation import TASK as PURE
from causalbench.core.tasks.pure_manipulation_dense import TASK as DENSE
from causalbench.core.tasks.stage_task import StageTask, Term
from causalbench.errors import UserError

GAMMA, STARTS = 0.99, 6
EXAMPLE = Path(__file__).parents[3] / "examples/a_task/causalbench_hover.py"


@cache
def _task(name):
    if name == "hover":
        spec = importlib.util.spec_from_file_location("causalbench_hover", EXAMPLE)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module.TASK
    return {"pure": PURE, "mobile": MOBILE, "dense": DENSE}[name]


PUSHES = {
    "pure": {"diagonal": {"armx": 1, "army": 1}, "up": {"armz": 1}, "down": {"armz": -1}, "tilt": {"armrx": 1}},
    "mobile": {"backwards": {"forward": -1}, "forwards": {"forward": 1}, "turn": {"turn": 1}, "arm": {"armz": 1}},
    "hover": {"diagonal": {"armx": 1, "army": 1}, "up": {"armz": 1}},
    "dense": {"diagonal": {"armx": 1, "army": 1, "grip": -1}, "up": {"armz": 1, "grip": -1}},
}
"""Task -> actions that leave a stage or undo what it was for."""
ANYWHERE = {
    "pure": {"oscillating": lambda t: {"armx": (-1) ** t, "army": (-1) ** t}, "grip": lambda t: {"grip": (-1) ** t}},
    "mobile": {"oscillating": lambda t: {"forward": 1 - 2 * (t // 4 % 2)}, "turning": lambda t: {"turn": 1}},
    "hover": {"oscillating": lambda t: {"armx": (-1) ** t}},
    "dense": {"grip": lambda t: {"grip": 1 - 2 * (t // 4 % 2), "armz": 0.1 * (t // 4 % 2)}},
}
"""Task -> actions by step, whatever the stage."""


def _set(task, actions, rows, values):
    for name, value in values.items():
        actions[rows, task.actions.index(name)] = value


def _scripts(name):
    """(id, script): a script changes the expert's `actions` (n, n_actions) of worlds in `stage` at step `t`."""
    task = _task(name)
    yield "idle", lambda t, stage, actions: actions.fill(0.0)
    for pattern, values in ANYWHERE[name].items():
        yield pattern, lambda t, stage, actions, values=values: _set(task, actions, slice(None), values(t))
    for first in range(2, task.n_stages + 1):
        for push, values in PUSHES[name].items():

            def script(t, stage, actions, first=first, values=values):
                _set(task, actions, stage >= first, values)

            yield f"{push} in {first}", script


def _returns(name, script):
    """Scalar -> (undiscounted, discounted) mean return of an episode from stage 1, and the reversals in it."""
    task = _task(name)
    worlds = make_scene_worlds(task, lambda: make(**task.scene_options), STARTS)
    env, n = StageTaskVectorEnv(worlds), STARTS
    env.reset(seed=0)
    worlds.reset(range(n), [np.random.default_rng(i) for i in range(n)], 1)
    obs = worlds.observe()
    scalars = {key: make_scalar(key, task, n, GAMMA) for key in ("shaped", "paper", "first_entry")}
    totals, running, reversals = {key: np.zeros((2, n)) for key in scalars}, np.ones(n, dtype=bool), 0
    for t in range(task.horizon):
        actions = worlds.expert()
        script(t, worlds.stage, actions)
        before = obs
        obs, _, terminated, truncated, infos = env.step(actions)
        for key, scalar in scalars.items():
            totals[key] += scalar(before, infos, terminated | truncated) * running * [[1.0], [GAMMA**t]]
        reversals += (infos["reversal"] & running).sum()
        running &= ~(terminated | truncated)
    env.close()
    return {key: tuple(total.mean(1)) for key, total in totals.items()}, reversals


@cache
def _expert(name):
    return _returns(name, lambda t, stage, actions: None)[0]


CASES = [pytest.param(name, script, id=f"{name}, {what}") for name in PUSHES for what, script in _scripts(name)]


@pytest.mark.parametrize(("name", "script"), CASES)
def test_no_way_back_and_forth_earns_more_than_the_expert(name, script):
    found, _ = _returns(name, script)
    undiscounted, discounted = found["shaped"]
    assert undiscounted < _expert(name)["shaped"][0]
    assert discounted < _expert(name)["shaped"][1]


@pytest.mark.parametrize("name", PUSHES)
def test_under_the_papers_sum_one_does(name):
    """The answer known of pure manipulation: about 250 an episode beside the expert's 19."""
    push = "backwards in 2" if name == "mobile" else "diagonal in 2"
    found, reversals = _returns(name, dict(_scripts(name))[push])
    assert reversals > STARTS
    for earned, by_expert in zip(found["paper"], _expert(name)["paper"], strict=True):
        assert earned > by_expert
    if name == "pure":
        assert found["paper"][0] > 200
        assert 15 < _expert(name)["paper"][0] < 25
        assert found["first_entry"][0] > _expert(name)["first_entry"][0]  # a bonus once an episode does not mend it


@pytest.mark.parametrize("name", PUSHES)
def test_a_potential_is_never_negative_and_grows_with_the_expert(name):
    task = _task(name)
    worlds = make_scene_worlds(task, lambda: make(**task.scene_options), STARTS)
    worlds.reset(range(STARTS), [np.random.default_rng(i) for i in range(STARTS)], 1)
    first = last = task.potential(worlds.observe()["state"], worlds.stage)
    grown = np.zeros(STARTS, dtype=bool)
    for _ in range(task.horizon):
        before = worlds.stage
        step = worlds.step(worlds.expert())
        now = task.potential(worlds.observe()["state"], worlds.stage)
        assert (now >= 0).all()
        assert (now > last)[step.next_stage > before].all()  # a step into a later stage always gains
        last = now
        grown |= step.success & (now > first)
    assert grown.all()
    worlds.close()


def _infos(stage, next_stage, rewards, success=False, terminated=False):
    return {
        "stage": np.array([stage]), "next_stage": np.array([next_stage]), "vector_reward": np.array([rewards]),
        "is_success": np.array([success]), "terminated": np.array([success or terminated]),
        "final_obs": {"state": np.array([[next_stage / 2]])},
    }  # fmt: skip


def _toy(**given):
    terms = (
        Term("progress", (1, 2, 3), True, ""),
        Term("crash", (1, 2, 3), False, ""),
        Term("bonus", (1, 2), False, ""),
    )
    return StageTask(
        name="toy", version=0, env_id="toy/Toy-v0", n_stages=3, actions=("a",), terms=terms, state_names=("x",),
        horizon=9, constants={}, manual_graph={}, **given,
    )  # fmt: skip


def test_the_shaped_scalar_by_hand():
    task = _toy(potential=lambda state, stage: state[:, 0] + 10.0 * stage, potential_terms=("progress", "bonus"))
    scalar, obs, over = make_scalar("shaped", task, 1, 0.5), {"state": np.array([[3.0]])}, np.array([False])
    # potential before: 3 + 10; after: 2/2 + 20, half of it; the crash counts, progress and bonus do not
    assert scalar(obs, _infos(1, 2, [7.0, -1.0, 2.0]), over) == pytest.approx(0.5 * 21 - 13 - 1)
    assert scalar(obs, _infos(1, 2, [7.0, -1.0, 2.0], success=True), over) == pytest.approx(0.5 * 21 - 13 + 8)
    assert scalar(obs, _infos(1, 2, [7.0, -1.0, 2.0], terminated=True), over) == pytest.approx(-13 - 1)


def test_a_bonus_counts_once_an_episode():
    first, over = FirstEntry(_toy(), 1), np.array([True])
    walk = [(1, 2, 2.0), (2, 1, 0.0), (1, 2, 0.0), (2, 3, 2.0), (3, 1, 0.0), (1, 3, 0.0)]
    for stage, next_stage, bonus in walk:
        paid = first(_infos(stage, next_stage, [1.0, -0.5, 2.0 if next_stage > stage else 0.0]), ~over)
        assert paid.tolist() == [[1.0, -0.5, bonus]]
    first(_infos(3, 3, [0.0, 0.0, 0.0]), over)
    assert first(_infos(1, 2, [0.0, 0.0, 2.0]), ~over).tolist() == [[0.0, 0.0, 2.0]]  # another episode


def test_a_task_without_a_potential_is_refused_unless_it_has_one_stage():
    with pytest.raises(UserError, match=r"task 'toy' has no `potential`.*`scalar: paper`"):
        make_scalar("shaped", _toy(), 1, 0.99)
    single = StageTask(
        name="one", version=0, env_id="toy/One-v0", n_stages=1, actions=("a",), terms=(Term("t", (1,), True, ""),),
        state_names=("x",), horizon=9, constants={}, manual_graph={},
    )  # fmt: skip
    scalar = make_scalar("shaped", single, 1, 0.99)
    assert scalar({}, _infos(1, 1, [2.0]), np.array([False])) == 2.0
    with pytest.raises(UserError, match="must be given together"):
        _toy(potential=lambda state, stage: state[:, 0])
