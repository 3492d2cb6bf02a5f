"""Algorithm 2 against the paper's own tables (its Tables I and II, and the action spaces it publishes)."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from causalbench.core.discovery.methods.kl.select import select_causal_actions

DATA = Path(__file__).parents[2] / "data"
ROUNDING = 5e-5  # the paper prints KL divergences to four decimals


def _rows(task: str) -> list:
    table = pd.read_csv(DATA / f"kl_{task}.csv")
    actions = [c[:-2] for c in table.columns if c.endswith("_n")]
    return [(task, int(r.stage), r.reward, actions, r) for _, r in table.iterrows()]


ROWS = _rows("pure_manipulation") + _rows("mobile_manipulation")
IDS = [f"{task}-{stage}-{reward}" for task, stage, reward, _, _ in ROWS]
SAMPLE_DEVIATION = {"r_rho", "r_eefx", "r_eefy", "r_eefz"}  # of Table I; the rest of both tables is population


def _propagated(kl: np.ndarray) -> float:
    """Largest change of (x - min) / (max - min) that rounding of x, min and max can cause, to first order."""
    return 2 * ROUNDING / np.ptp(kl)


@pytest.mark.parametrize(("task", "stage", "reward", "actions", "row"), ROWS, ids=IDS)
def test_normalised_values_and_cv_are_the_papers(task, stage, reward, actions, row):
    kl = row[actions].to_numpy(dtype=float)
    ddof = 1 if task == "mobile_manipulation" and reward in SAMPLE_DEVIATION else 0
    found = select_causal_actions(kl, ddof=ddof)
    published = row[[f"{a}_n" for a in actions]].to_numpy(dtype=float)
    assert found.cv == pytest.approx(row.cv, abs=0.0051)
    assert _propagated(kl) < 2.2e-3
    np.testing.assert_allclose(found.normalised, published, atol=_propagated(kl) + ROUNDING)


@pytest.mark.parametrize(("task", "stage", "reward", "actions", "row"), ROWS, ids=IDS)
@pytest.mark.parametrize("ddof", [0, 1])
def test_selections_are_those_of_the_published_normalised_values(task, stage, reward, actions, row, ddof):
    found = select_causal_actions(row[actions].to_numpy(dtype=float), ddof=ddof)
    published = row[[f"{a}_n" for a in actions]].to_numpy(dtype=float) > 0.10
    assert row.cv > 1.0
    np.testing.assert_array_equal(found.selected, published)


def _selected_actions(task: str, stage: int) -> set[str]:
    return {
        action
        for t, s, _, actions, row in ROWS
        if (t, s) == (task, stage)
        for action, chosen in zip(actions, select_causal_actions(row[actions].to_numpy(float)).selected, strict=True)
        if chosen
    }


PUBLISHED = pd.read_csv(DATA / "paper_action_spaces.csv")


@pytest.mark.parametrize("stage", [1, 2, 3, 4])
def test_pure_manipulation_gives_the_published_action_spaces(stage):
    published = PUBLISHED.query("task == 'pure_manipulation' and stage == @stage").actions.item()
    # Table II has r_gripper in stage 4 only; in stages 1 to 3 the paper declares grip.
    declared = {"grip"} if stage < 4 else set()
    assert _selected_actions("pure_manipulation", stage) | declared == set(published.split())


def test_mobile_manipulation_contradicts_its_published_stage_3():
    for stage in (1, 2):
        published = PUBLISHED.query("task == 'mobile_manipulation' and stage == @stage").actions.item()
        assert _selected_actions("mobile_manipulation", stage) == set(published.split())
    assert _selected_actions("mobile_manipulation", 3) == {"armx", "army", "armz"}


def test_direct_branch_when_all_actions_are_alike():
    found = select_causal_actions([0.5, 0.4, 0.6, 0.005])  # mean 0.37625, cv 0.594
    assert found.threshold == 0.01
    assert found.selected.tolist() == [True, True, True, False]


@pytest.mark.parametrize("value", [0.0, 0.3])
def test_equal_values_select_by_the_direct_threshold(value):
    found = select_causal_actions([value] * 5)
    assert found.cv == pytest.approx(0.0, abs=1e-12)
    assert found.selected.tolist() == [value > 0.01] * 5


@pytest.mark.parametrize("bad", [[], [0.1, float("nan")], [-0.1, 0.2], [[0.1], [0.2]]])
def test_refuses_what_is_no_list_of_divergences(bad):
    with pytest.raises(ValueError, match="non-negative KL"):
        select_causal_actions(bad)
