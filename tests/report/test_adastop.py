"""Seeds until decided against AdaStop's own package, on the same success areas."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from adastop import MultipleAgentsComparator
from looks import statement, told

from causalbench.report.stats import area_under

CURVES = "docs/data/ablation_curves.csv"
METHODS = ("cmSAC", "cmmSAC", "mSAC", "cSAC")
HYPOTHESES = ("cmSAC > mSAC", "cmSAC > cSAC", "cmmSAC > mSAC", "cmSAC > cmmSAC")
WORDS = {"better": "larger", "worse": "smaller"}


def drawn(pytestconfig: pytest.Config, backend: str, seed: int, shuffled: bool) -> dict[str, list[float]]:
    """Ten areas of each method, drawn from its committed seeds, or from those of all methods if `shuffled`."""
    curves = pd.read_csv(pytestconfig.rootpath / CURVES).query("backend == @backend and method in @METHODS")
    areas = {
        key: area_under(list(curve["env_steps"]), list(curve["success_deterministic"]), 20_000)
        for key, curve in curves.groupby(["method", "seed"])
    }
    rng, pools = np.random.default_rng(seed), pd.Series(areas)
    return {m: list(rng.choice(pools.to_numpy() if shuffled else pools[m].to_numpy(), 10)) for m in METHODS}


def adastop(areas: dict[str, list[float]]) -> list[str]:
    """AdaStop's decision on each hypothesis after at most ten seeds, at looks of five."""
    pairs = np.array([[METHODS.index(name) for name in text.split(" > ")] for text in HYPOTHESES])
    comparator = MultipleAgentsComparator(n=5, K=2, B=5_000, alpha=0.05, seed=0, comparisons=pairs)
    for seeds in (5, 10):
        if not comparator.is_finished:
            comparator.partial_compare({m: np.array(values[:seeds]) for m, values in areas.items()}, verbose=False)
    return list(comparator.decisions.values())


@pytest.mark.parametrize("backend", ["kinematic", "gymrob"])
@pytest.mark.parametrize("seed", [0, 1])
def test_clear_claims_are_decided_by_both_and_no_verdict_contradicts(
    pytestconfig: pytest.Config, backend: str, seed: int
) -> None:
    areas = drawn(pytestconfig, backend, seed, shuffled=False)
    _, verdicts = told(statement(HYPOTHESES, (backend,)), areas)
    ours, theirs = [row["verdict"] for row in verdicts.values()], adastop(areas)
    assert ours[:3] == ["better"] * 3
    assert theirs[:3] == ["larger"] * 3
    both = [(WORDS[one], other) for one, other in zip(ours, theirs, strict=True) if one in WORDS and other != "equal"]
    assert all(one == other for one, other in both)


@pytest.mark.parametrize("seed", [0, 1])
def test_where_all_methods_are_the_same_neither_decides(pytestconfig: pytest.Config, seed: int) -> None:
    areas = drawn(pytestconfig, "kinematic", seed, shuffled=True)
    _, verdicts = told(statement(HYPOTHESES, ("kinematic",)), areas)
    assert {row["verdict"] for row in verdicts.values()} == {"not decided"}
    assert set(adastop(areas)) == {"equal"}
