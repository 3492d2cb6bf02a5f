"""Changed scenes: what each does, that the expert still solves it, and that it can be restored."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager

import numpy as np
import pytest

from causalbench.core.discovery.truth.oracle import Grade, consult_oracle
from causalbench.core.staged.worlds import Worlds
from causalbench.core.tasks.changes.scenes import SCENES, chance
from causalbench.errors import UnknownNameError, UserError
from causalbench.plugins.manager import installed
from causalbench.plugins.venues import worlds_maker
from causalbench.suite.task_identity import task_identity

BASE = "pure_manipulation"
CHANGES = {
    "table_height": 0.05,
    "near_limit": 0.08,
    "base_yaw": 0.5,
    "box_size": 1.3,
    "box_mass": 3,
    "sensor_noise": 0.01,
    "action_lag": 1,
    "distractors": 3,
}


@contextmanager
def worlds_of(change: str, n: int | None = None) -> Iterator[Worlds]:
    """Worlds of pure manipulation with a change, "" for none, on kinematic, each reset from a seed of its own."""
    plugins = installed()
    make = worlds_maker(plugins.backend("kinematic"), plugins.task(BASE + change))
    with closing(make(n)) as worlds:
        worlds.reset(range(worlds.n), [np.random.default_rng(seed) for seed in range(worlds.n)])
        yield worlds


def test_there_is_a_number_for_every_change() -> None:
    assert {*CHANGES} == {*SCENES}


@pytest.mark.parametrize(("name", "number"), CHANGES.items(), ids=CHANGES)
def test_the_expert_solves_it(name: str, number: float) -> None:
    with worlds_of(f"+{name}={number}", 4) as worlds:
        solved = np.zeros(4, dtype=bool)
        for _ in range(60):
            solved |= worlds.step(worlds.expert()).success
        assert solved.sum() >= 3


@pytest.mark.parametrize(("name", "number"), CHANGES.items(), ids=CHANGES)
def test_a_restored_world_goes_on_the_same(name: str, number: float) -> None:
    with worlds_of(f"+{name}={number}", 2) as worlds:
        rng = np.random.default_rng(0)
        actions = rng.uniform(-1.0, 1.0, (5, 2, len(worlds.task.actions)))
        worlds.step(actions[4])
        kept = [worlds.snapshot(world) for world in range(2)]
        first = [(worlds.step(a).rewards, worlds.states()) for a in actions]
        worlds.restore([0, 1], kept)
        for (paid, state), a in zip(first, actions, strict=True):
            np.testing.assert_array_equal(worlds.step(a).rewards, paid)
            np.testing.assert_array_equal(worlds.states(), state)


@pytest.mark.parametrize(("name", "number"), CHANGES.items(), ids=CHANGES)
def test_its_identity_is_its_own(name: str, number: float) -> None:
    plugins = installed()
    mine, base = (task_identity(plugins.task(BASE + change)) for change in (f"+{name}={number}", ""))
    assert (mine.name, mine.data) != (base.name, base.data)
    assert mine.data != base.data or mine.behaviour != base.behaviour or name == "box_mass"


def test_noise_has_the_size_that_is_asked_for() -> None:
    with worlds_of("", 64) as plain, worlds_of("+sensor_noise=0.02", 64) as noisy:
        off = noisy.states()[:, :15] - plain.states()[:, :15]
    assert off.std() == pytest.approx(0.02, rel=0.1)
    assert abs(off.mean()) < 0.003


def test_chance_is_a_hash_with_mean_0_and_variance_1() -> None:
    values = np.random.default_rng(0).normal(size=(4000, 3))
    found = chance(values, 2)
    np.testing.assert_array_equal(found, [chance(row, 2) for row in values])
    np.testing.assert_allclose(found.mean(0), 0.0, atol=0.06)
    np.testing.assert_allclose(found.var(0), 1.0, atol=0.06)
    assert abs(np.corrcoef(found.T)[0, 1]) < 0.05


def test_a_late_action_moves_the_hand_one_step_later() -> None:
    with worlds_of("+action_lag=1") as late, worlds_of("") as plain:
        up, idle = np.eye(7)[2], np.zeros(7)
        start = plain.states().copy()
        late.step(up)
        np.testing.assert_array_equal(late.states(), start)
        late.step(idle)
        plain.step(up)
        np.testing.assert_array_equal(late.states(), plain.states())


def test_a_late_action_that_is_held_is_executed_from_the_second_step_on() -> None:
    with worlds_of("+action_lag=1") as late, worlds_of("") as plain:
        down = -np.eye(7)[2]
        late.step(down, repeat=3)
        plain.step(down, repeat=2)
        np.testing.assert_array_equal(late.states(), plain.states())


def causes(change: str, states: int = 25) -> dict[str, set[str]]:
    """Term of stage 1 -> the actions that matter to it, asked of the oracle."""
    plugins = installed()
    task = plugins.task(BASE + change)
    make = worlds_maker(plugins.backend("kinematic"), task)
    truth = consult_oracle(task, make, states, 0, lambda share, text: None)[0]
    return {
        term: {
            name
            for name, row in zip(truth.actions, truth.grades(), strict=True)
            if row[column] in (Grade.weak, Grade.strong)
        }
        for column, term in enumerate(truth.terms)
    }


def test_a_turned_base_makes_two_actions_causes_of_one_term() -> None:
    assert causes("")["r_eefx"] == {"army"}
    assert causes("+base_yaw=0.5")["r_eefx"] == {"armx", "army"}


def test_nothing_causes_a_distractor_and_it_causes_nothing() -> None:
    own, among = installed().task(BASE), causes("+distractors=1", 10)
    others = {term: found for term, found in among.items() if term not in own.term_names}
    assert others == {f"r_nothing_{i}": set() for i in range(1, 7)}
    assert set().union(*among.values()) <= {*own.actions}


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ("+base_yaw", UserError, "expected base_yaw=NUMBER, got ''"),
        ("+base_yaw=far", UserError, "expected base_yaw=NUMBER, got 'far'"),
        ("+base_yow=1", UnknownNameError, "base_yaw=NUMBER"),
        ("+action_lag=2", UserError, "expected 1"),
        ("+box_size=0", UserError, "expected a factor above 0"),
        ("+base_yaw=1+merged", UserError, "comes first"),
    ],
)
def test_a_wrong_change_is_refused(change: str, error: type[UserError], message: str) -> None:
    with pytest.raises(error, match=message):
        installed().task(BASE + change)
