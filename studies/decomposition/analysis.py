"""One table of what each part is worth: `python studies/decomposition/analysis.py runs/decomposition*`.

A row per task, backend, method and grid point: seeds, the area under the success curve at 20,000 steps and at the
budget, the median of the steps to 90% (`inf`: fewer than half got there), reversals, and the mean return of the final
episodes beside that of the scripted expert on the same starts of the kinematic backend.
"""

import statistics
import sys
from pathlib import Path

import numpy as np
import pandas as pd

import causalbench
from causalbench.core.learners.settings import FIRST_START
from causalbench.report.stats import area_under

EARLY = 20_000  # env steps
EPISODES = 20
KEYS = ["task", "backend", "method", "grid_point"]


def early_area(curve: pd.DataFrame) -> float:
    """Area under a cell's success curve up to `EARLY` steps, which may lie between two evaluations or after all."""
    steps, success = [0, *curve["env_steps"]], [0.0, *curve["success_deterministic"]]
    here = [(s, v) for s, v in zip(steps, success, strict=True) if 0 < s < EARLY]
    here.append((EARLY, float(np.interp(EARLY, steps, success))))
    return area_under([s for s, _ in here], [v for _, v in here], EARLY)


def expert_return(task: str) -> float:
    """The mean sum of all terms in the scripted expert's episodes."""
    env, total = causalbench.make_env(task, "kinematic"), 0.0
    for episode in range(EPISODES):
        env.reset(seed=FIRST_START + episode, options={"stage": 1})
        over = False
        while not over:
            _, reward, terminated, truncated, _ = env.step(env.worlds.expert())
            total, over = total + reward, terminated or truncated
    env.close()
    return total / EPISODES


def table(runs: list[Path]) -> pd.DataFrame:
    """The rows of all `runs`."""
    results = pd.concat([pd.read_csv(run / "results.csv") for run in runs]).fillna({"grid_point": ""})
    curves = pd.concat([pd.read_csv(run / "curves.csv") for run in runs]).fillna({"grid_point": ""})
    early = {key: early_area(curve) for key, curve in curves.groupby([*KEYS, "seed"])}
    results["early_auc"] = [early[key] for key in results[[*KEYS, "seed"]].itertuples(index=False, name=None)]
    results["steps_to_90"] = results["steps_to_90"].fillna(np.inf)
    rows = results.groupby(KEYS, as_index=False).agg(
        seeds=("seed", "nunique"),
        early_auc=("early_auc", "mean"),
        success_auc=("success_auc", "mean"),
        steps_to_90=("steps_to_90", statistics.median),
        success=("success_deterministic", "mean"),
        sampled=("success_sampled", "mean"),
        reversals=("reversals_per_1000_steps", "mean"),
        mean_return=("mean_return", "mean"),
    )
    experts = {task: expert_return(task) for task in rows["task"].unique()}
    return rows.assign(expert_return=rows["task"].map(experts))


if __name__ == "__main__":
    print(table([Path(folder) for folder in sys.argv[1:]]).round(3).to_string(index=False))
