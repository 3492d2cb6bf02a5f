"""Bad decompositions of pure manipulation: named changes of the task, each of which cuts it in its own way."""

from __future__ import annotations

import numpy as np
import pytest

from causalbench.core.tasks.changes.decompositions import DECOMPOSITIONS
from causalbench.errors import UnknownNameError, UserError
from causalbench.plugins.manager import installed
from causalbench.plugins.venues import worlds_maker
from causalbench.suite.task_identity import task_identity

BASE = "pure_manipulation"


@pytest.mark.parametrize("name", DECOMPOSITIONS)
def test_what_is_paid_is_what_pure_manipulation_pays_for_the_same_motion(name: str) -> None:
    """Of the terms that both have in the stage, the bonus aside, from the same start by the same actions."""
    plugins = installed()
    base, cut = (plugins.task(n) for n in (BASE, f"{BASE}+{name}"))
    worlds, others = (worlds_maker(plugins.backend("kinematic"), task)() for task in (base, cut))
    for world in (worlds, others):
        world.reset([0], [np.random.default_rng(3)])
    rng, shared = np.random.default_rng(4), 0
    for _ in range(60):
        stage, other = int(worlds.stage), int(others.stage)
        wanted = worlds.expert() if rng.random() < 0.5 else rng.uniform(-1.0, 1.0, 7)
        one, two = worlds.step(wanted), others.step(wanted)
        np.testing.assert_array_equal(worlds.states(), others.states())
        names = {*base.stage_terms(stage)} & {*cut.stage_terms(other)} - {"r_success", "r_gripper"}
        shared += len(names)
        for term in names:
            paid = one.rewards[base.term_names.index(term)]
            assert two.rewards[cut.term_names.index(term)] == pytest.approx(paid, abs=1e-12), (term, stage, other)
        if one.terminated:
            break
    assert shared > 20
    worlds.close(), others.close()


def test_a_change_has_an_identity_of_its_own() -> None:
    plugins = installed()
    found = {str(task_identity(plugins.task(n)).plain) for n in (BASE, *(f"{BASE}+{name}" for name in DECOMPOSITIONS))}
    assert len(found) == 1 + len(DECOMPOSITIONS)
    assert plugins.task(BASE) is plugins.tasks[BASE]


def test_a_wrong_change_is_refused_with_what_exists() -> None:
    with pytest.raises(UnknownNameError, match="merged"):
        installed().task(f"{BASE}+mergd")
    with pytest.raises(UserError, match="of pure_manipulation's stages alone"):
        installed().task("stack+merged")
