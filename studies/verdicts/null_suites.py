"""How often verdicts are wrong, and how often they are found: `python studies/verdicts/null_suites.py [SUITES]`.

Suites are simulated by drawing success areas from the committed curves of docs/data/ablation_curves.csv, and judged by
the very functions that judge a run.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from causalbench.report.comparison import pairs_pay
from causalbench.report.permutation import Array, regroup
from causalbench.report.sequential import with_looks
from causalbench.report.stats import ALPHA, area_under
from causalbench.suite.hypotheses import Statement

CURVES = Path(__file__).parents[2] / "docs/data/ablation_curves.csv"
BUDGET = 20_000
METHODS = ("cmSAC", "cmmSAC", "mSAC", "cSAC")
HYPOTHESES = ((0, 2), (0, 3), (1, 2), (0, 1))
"""Those of suites/pure_manip.yaml, as places in `METHODS`."""
LEARNING = ("cmSAC", "cmmSAC", "cmSAC-scalar", "cmSAC-other", "cmSAC-plus1", "cmPPO", "cmmPPO")
"""Methods of which some seed succeeds: their areas vary."""
BATCH = 250
FEW = {"most": 2_000, "draws": 2_000}
"""Fewer drawn regroupings than a run's verdicts have, which hold the level as well and decide a little less."""
Areas = Mapping[str, Array]
"""Backend -> success areas (suites, methods, seeds)."""


def areas_by_method() -> dict[str, dict[str, Array]]:
    """Backend -> method -> the areas of its seeds."""
    curves = pd.read_csv(CURVES).groupby(["backend", "method", "seed"])
    found: dict[str, dict[str, list[float]]] = {}
    for (backend, method, _), curve in curves:
        area = area_under(list(curve["env_steps"]), list(curve["success_deterministic"]), BUDGET)
        found.setdefault(backend, {}).setdefault(method, []).append(area)
    return {b: {m: np.array(values) for m, values in methods.items()} for b, methods in found.items()}


def null_suites(
    pools: Mapping[str, Array], suites: int, seeds: int, shared: float, rng: np.random.Generator
) -> dict[str, Array]:
    """Suites in which all methods are the same: every area is drawn from the backend's pool.

    With a chance of `shared` a seed has the same luck, the same draw, with every method.
    """
    shape = (suites, len(METHODS), seeds)
    found = {}
    for backend, pool in pools.items():
        own, common = rng.choice(pool, size=shape), rng.choice(pool, size=(suites, 1, seeds))
        found[backend] = np.where(rng.random((suites, 1, seeds)) < shared, common, own)
    return found


def p_values(areas: Areas, hypotheses: Sequence[tuple[int, int]] = HYPOTHESES) -> Array:
    """(suites, comparisons): every hypothesis on all backends together and on each."""
    boards = [list(areas), *([backend] for backend in areas)]
    columns = [
        _p([areas[b][:, i] for b in board], [areas[b][:, j] for b in board]) for i, j in hypotheses for board in boards
    ]
    return np.stack(columns, axis=1)


def _p(left: Sequence[Array], right: Sequence[Array]) -> Array:
    found = []
    for start in range(0, len(left[0]), BATCH):
        a, b = ([x[start : start + BATCH] for x in side] for side in (left, right))
        pairs = pairs_pay(a, b)
        p = regroup(a, b, **FEW).two_sided
        if pairs.any():
            p[pairs] = regroup([x[pairs] for x in a], [x[pairs] for x in b], paired=True, **FEW).two_sided
        found.append(p)
    return np.concatenate(found)


def rejected(p: Array, level: float = ALPHA) -> NDArray[np.bool_]:
    """Holm's step-down along the last axis; infinite p-values are of comparisons that are decided already."""
    order = np.argsort(p, axis=-1)
    left = np.isfinite(p).sum(axis=-1, keepdims=True) - np.arange(p.shape[-1])
    passed = np.take_along_axis(p, order, axis=-1) <= level / np.maximum(left, 1)
    kept = np.logical_and.accumulate(passed, axis=-1)
    found = np.zeros_like(kept)
    np.put_along_axis(found, order, kept, axis=-1)
    return found


def until_decided(areas: Areas, hypotheses: Sequence[tuple[int, int]] = HYPOTHESES) -> tuple[NDArray[np.bool_], Array]:
    """What is decided, (suites, comparisons), and the seeds spent, (suites,), by a run that stops at a look."""
    suites, _, total = next(iter(areas.values())).shape
    stated = tuple(f"{METHODS[i]} > {METHODS[j]}" for i, j in hypotheses)
    looks = with_looks(Statement("", "", stated, tuple(areas), tuple(range(total)))).looks
    decided = np.zeros((suites, len(hypotheses) * (len(areas) + 1)), dtype=bool)
    running, spent = np.ones(suites, dtype=bool), np.zeros(suites)
    for seeds in looks:
        if not running.any():
            break
        p = p_values({b: values[running, :, :seeds] for b, values in areas.items()}, hypotheses)
        decided[running] |= rejected(np.where(decided[running], np.inf, p), ALPHA / len(looks))
        spent[running] = seeds
        running = ~decided[:, :: len(areas) + 1].all(axis=1)  # on all backends together
    return decided, spent


def family_error(pools: Mapping[str, Array], suites: int, seeds: int, shared: float, seed: int = 0) -> float:
    """The share of null suites with any verdict of better or worse."""
    areas = null_suites(pools, suites, seeds, shared, np.random.default_rng(seed))
    return float(rejected(p_values(areas)).any(axis=-1).mean())


def committed(suites: int, seeds: int, rng: np.random.Generator) -> dict[str, Array]:
    """Suites in which each method's areas are drawn from its own committed seeds."""
    return {
        backend: np.stack([rng.choice(found[m], size=(suites, seeds)) for m in METHODS], axis=1)
        for backend, found in areas_by_method().items()
    }


def power(suites: int, seeds: int, seed: int = 0) -> pd.DataFrame:
    """How often each stated difference is found in `committed` suites."""
    areas = committed(suites, seeds, np.random.default_rng(seed))
    shown = rejected(p_values(areas)).mean(axis=0).reshape(len(HYPOTHESES), -1)
    names = [f"{METHODS[i]} > {METHODS[j]}" for i, j in HYPOTHESES]
    return pd.DataFrame(shown, index=names, columns=["all", *areas]).assign(seeds=seeds)


def stopping(suites: int, seeds: int, seed: int = 0) -> pd.DataFrame:
    """Of suites that stop when decided: the share with any verdict, and the seeds spent of so many.

    Null suites must have none; clear-cut claims, those of the committed seeds but for cmSAC > cmmSAC, should stop soon.
    """
    found = []
    for name, pool in pools().items():
        decided, spent = until_decided(null_suites(pool, suites, seeds, 0.0, np.random.default_rng(seed)))
        found.append((f"null, {name}", decided.any(axis=1).mean(), spent.mean()))
    areas = committed(suites, seeds, np.random.default_rng(seed))
    decided, spent = until_decided(areas, HYPOTHESES[:3])
    found.append(("clear-cut claims", decided[:, ::3].all(axis=1).mean(), spent.mean()))
    return pd.DataFrame(found, columns=["suites", "decided", "mean seeds"])


def bootstrap_error(pool: Array, suites: int, seeds: int, seed: int = 0) -> float:
    """How often a percentile bootstrap of the difference of means, at 95%, leaves out the true difference, none."""
    rng = np.random.default_rng(seed)
    wrong = 0
    for _ in range(suites):
        a, b = (rng.choice(pool, size=seeds) for _ in range(2))
        means = [rng.choice(x, size=(1_000, seeds)).mean(axis=1) for x in (a, b)]
        low, high = np.quantile(means[0] - means[1], [0.025, 0.975])
        wrong += not low <= 0 <= high
    return wrong / suites


def interval_error(pool: Array, suites: int, seeds: int, seed: int = 0) -> float:
    """How often the interval of the test leaves out the true difference, none."""
    rng = np.random.default_rng(seed)
    intervals = (regroup([rng.choice(pool, size=seeds)], [rng.choice(pool, size=seeds)]) for _ in range(suites))
    found = [regrouped.shifts().interval(ALPHA) for regrouped in intervals]
    return float(np.mean([bounds is not None and not bounds[0] <= 0 <= bounds[1] for bounds in found]))


def unlike_spread(pool: Array, suites: int, seeds: int, seed: int = 0) -> float:
    """How often areas of a pool are told apart, at 5%, from ones that are always its mean: the worst of equal means."""
    drawn = np.random.default_rng(seed).choice(pool, size=(suites, seeds))
    return float((_p([drawn], [np.full_like(drawn, pool.mean())]) <= ALPHA).mean())


def pools() -> dict[str, dict[str, Array]]:
    """Name -> backend -> the areas that null suites draw from."""
    known = areas_by_method()
    return {
        "all methods": {b: np.concatenate(list(found.values())) for b, found in known.items()},
        "methods that learn": {b: np.concatenate([found[m] for m in LEARNING]) for b, found in known.items()},
    }


def main(suites: int) -> None:
    """Print the tables of the README."""
    print("| areas from | seeds with the same luck | seeds | family error |\n|---|---|---|---|")
    for name, pool in pools().items():
        for shared in (0.0, 0.7):
            for seeds in (3, 5, 10):
                print(
                    f"| {name} | {shared:.0%} | {seeds} | {family_error(pool, suites, seeds, shared):.4f} |", flush=True
                )
    print("\n| one comparison, 95% | seeds | difference of none left out |\n|---|---|---|")
    pool = pools()["methods that learn"]["gymrob"]
    for seeds in (3, 5, 8):
        print(f"| percentile bootstrap | {seeds} | {bootstrap_error(pool, suites, seeds):.4f} |", flush=True)
        print(f"| interval of the exact test | {seeds} | {interval_error(pool, suites, seeds):.4f} |", flush=True)
    for seeds in (4, 5, 8):
        print(f"| exact test, equal means, one without spread | {seeds} | {unlike_spread(pool, suites, seeds):.4f} |")
    print("\n" + stopping(suites, 10).round(4).to_string())
    print("\n" + pd.concat([power(suites, seeds) for seeds in (3, 5, 10)]).round(3).to_string())


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000)
