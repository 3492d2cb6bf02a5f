"""The tables and curves of docs/learning_results.md, from the CSV files in docs/data alone.

    python benchmarks/learning_results.py                                # write them into the page
    python benchmarks/learning_results.py --check                        # fail if the page says something else
    python benchmarks/learning_results.py --read runs/ablation-quick     # first renew what is read from a run folder

`--read` takes the folders of suites that the page shows: ablation, pure_manip, one_agent, mobile_manip. Cells that a
folder does not have keep their rows.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import pages
import pandas as pd
import tuning_grid
import yaml
from pages import Frames, Tables, merge_into, rounded

from causalbench.core.learners.methods import METHODS, Method
from causalbench.core.tasks.reward_scales import SCALES
from causalbench.report.tables import KEYS

matplotlib.rcParams["svg.hashsalt"] = "causalbench"  # equal data, equal bytes
PAGE = Path("docs/learning_results.md")
ORDER = [method.name for method in METHODS]
# Okabe and Ito's, which colour-blind readers tell apart; yellow is too light for a line.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00")


def read_run(run: Path, docs: Path) -> str:
    """Renew the run's cells in SUITE_curves.csv and, with their collisions and seconds, in SUITE_results.csv.

    Returns SUITE.
    """
    name = yaml.safe_load((run / "suite.yaml").read_text(encoding="utf-8"))["name"]
    results = pd.read_csv(run / "results.csv")
    seconds = pd.read_csv(run / "timing.csv").set_index("cell")["seconds"]
    returns = pd.read_csv(run / "returns.csv")
    last = returns[returns["env_steps"] == returns.groupby("cell")["env_steps"].transform("max")]
    collisions = last[last["term"].str.startswith("r_collision")]
    hits = collisions.groupby("cell")["mean_return"].sum().abs() / abs(SCALES.collision)
    cells = {cell.rpartition("-")[0]: cell for cell in seconds.index}
    made = [cells[f"{r.task}-{r.backend}-{r.method}-s{r.seed}"] for r in results.itertuples()]
    results = results.assign(collisions_per_episode=hits[made].to_numpy(), seconds=seconds[made].round(1).to_numpy())
    for kind, table in (("results", results), ("curves", pd.read_csv(run / "curves.csv"))):
        merge_into(docs / f"{name}_{kind}.csv", table, KEYS)
    return str(name)


def draw(name: str, docs: Path) -> None:
    """Success over environment steps as NAME_curves.svg: mean over seeds, thick, and every seed.

    A column per backend; a row of the methods, and one of each family's ablations and controls beside their model.
    """
    curves = pd.read_csv(docs / f"{name}_curves.csv")
    backends, found = list(dict.fromkeys(curves["backend"])), [m for m in METHODS if m.name in set(curves["method"])]
    rows = [[m for m in found if "-" not in m.name]]
    for model in ("cmSAC", "cmPPO"):
        family = [m for m in found if m.name.split("-")[0] == model]
        rows += [family] if len(family) > 1 else []
    size = (1.6 + 4.5 * len(backends), 0.5 + 3.2 * len(rows))
    figure, axes = plt.subplots(
        len(rows), len(backends), figsize=size, sharex=True, sharey=True, squeeze=False, layout="constrained"
    )
    for methods, panels in zip(rows, axes, strict=True):
        for backend, axis in zip(backends, panels, strict=True):
            for method in methods:
                line = _line(method)
                peers = [m for m in methods if _line(m) == line]
                style = {"color": COLOURS[peers.index(method)], "linestyle": line}
                here = curves[(curves["backend"] == backend) & (curves["method"] == method.name)]
                wide = here.pivot(index="env_steps", columns="seed", values="success_deterministic")
                axis.plot(wide.index, wide, lw=0.6, alpha=0.5, **style)
                axis.plot(wide.index, wide.mean(axis=1), lw=2, label=method.name, **style)
            axis.set(title=backend, ylim=(-0.03, 1.03))
        panels[0].set_ylabel("success, deterministic policy")
        panels[-1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    for axis in axes[-1]:
        axis.set_xlabel("environment steps")
    figure.savefig(docs.parent / "figures" / f"{name}_curves.svg", metadata={"Date": None})
    plt.close(figure)


def _line(method: Method) -> str:
    """Controls are dotted, PPO is dashed."""
    return ":" if method.control != "none" else {"SAC": "-", "PPO": "--"}[method.learner]


# One function a table of the page.


def _each(values: pd.Series, form: str) -> str:
    """Every seed's value; a dash for one that never got there."""
    return " ".join("-" if pd.isna(v) else form.format(v) for v in values)


def by_method(results: pd.DataFrame) -> pd.DataFrame:
    """A row per backend and method, every seed's values side by side."""
    rows = []
    for backend in dict.fromkeys(results["backend"]):
        for method in ORDER:
            here = results.query("backend == @backend and method == @method").sort_values("seed")
            if here.empty:
                continue
            reached, cost = here["steps_to_90"], here["discovery_env_steps"]
            row = {"backend": backend, "method": method, "success AUC, mean": f"{here['success_auc'].mean():.2f}"}
            row |= {"success AUC": _each(here["success_auc"], "{:.2f}")}
            row |= {"success": _each(here["success_deterministic"], "{:.2f}")}
            row |= {"held": _each(here["held_rate"], "{:.2f}"), "steps to 90%": _each(reached, "{:,.0f}")}
            row |= {"with discovery": _each(reached + cost, "{:,.0f}")}
            row |= {"stage at the end": _each(here["mean_final_stage"], "{:.1f}")}
            rows.append(row | {"reversals per 1,000 steps": _each(here["reversals_per_1000_steps"], "{:.0f}")})
    return pd.DataFrame(rows)


def learning(frames: Frames) -> pd.DataFrame:
    """All methods and controls on pure manipulation."""
    return by_method(frames["ablation_results"])


def three_simulators(frames: Frames) -> pd.DataFrame:
    """The four methods of the paper on three simulators."""
    return by_method(frames["pure_manip_results"])


PARTS = {
    "both": ("cmSAC", "mSAC"),
    "the smaller action space, without the factored gradient": ("cmSAC-scalar", "mSAC"),
    "the factored gradient, without the smaller action space": ("cmSAC-full", "mSAC"),
    "the factored gradient, on the causal actions": ("cmSAC", "cmSAC-scalar"),
    "the smaller action space, with the factored gradient": ("cmSAC", "cmSAC-full"),
    "the discovered matrix in place of its rows shuffled": ("cmSAC", "cmSAC-shuffled"),
    "the discovered matrix in place of as many edges drawn anew": ("cmSAC", "cmSAC-redrawn"),
    "the discovered actions in place of as many others": ("cmSAC", "cmSAC-other"),
    "one action fewer a stage": ("cmSAC", "cmSAC-plus1"),
    "two actions fewer a stage": ("cmSAC", "cmSAC-plus2"),
}


def parts(frames: Frames) -> pd.DataFrame:
    """What each part of the method adds to the area under the success curve: differences, seed by seed."""
    auc = frames["ablation_results"].pivot(index=["backend", "seed"], columns="method", values="success_auc")
    rows = []
    for part, (with_it, without) in PARTS.items():
        row = {"what": part, "is": f"{with_it} - {without}"}
        for backend, here in (auc[with_it] - auc[without]).groupby(level="backend"):
            row[backend] = f"{here.mean():+.2f} ({_each(here, '{:+.2f}')})"
        rows.append(row)
    return pd.DataFrame(rows)


def one_agent(frames: Frames) -> pd.DataFrame:
    """cmSAC against one plain SAC on the summed reward."""
    table = frames["one_agent_results"]
    names = ["method", "seed", "env_steps", "seconds", "steps_to_90", "success_deterministic", "success_sampled",
             "mean_final_stage", "reversals_per_1000_steps"]  # fmt: skip
    digits = {"seconds": 0, "env_steps": 0, "steps_to_90": 0, "mean_final_stage": 1, "reversals_per_1000_steps": 0}
    return rounded(table[names], **digits)


def mobile(frames: Frames) -> pd.DataFrame:
    """Mobile manipulation, a row per cell."""
    table = frames["mobile_manip_results"]
    names = ["backend", "method", "seed", "success_deterministic", "success_sampled", "success_auc", "steps_to_90",
             "mean_final_stage", "reversals_per_episode", "collisions_per_episode"]  # fmt: skip
    digits = {"success_auc": 2, "steps_to_90": 0, "reversals_per_episode": 2, "collisions_per_episode": 1}
    return rounded(table[names], mean_final_stage=1, **digits)


def tuning(frames: Frames) -> pd.DataFrame:
    """The point that each method takes."""
    digits = dict.fromkeys(("success_auc", "stage_auc", "preset_success_auc", "preset_stage_auc"), 2)
    table = tuning_grid.chosen(frames["tuning_grid"])
    return rounded(table.assign(learning_rate=table["learning_rate"].astype(str)), **digits)


def grid(frames: Frames) -> pd.DataFrame:
    """Success AUC and stage AUC of every point, means over seeds."""
    mean = frames["tuning_grid"].groupby(["method", *tuning_grid.POINT])[tuning_grid.SCORE].mean()
    cells = mean.apply(lambda r: f"{r.success_auc:.2f} ({r.stage_auc:.2f})", axis=1).unstack("method")
    return cells[[m for m in ORDER if m in cells]].fillna("").reset_index()


TABLES: Tables = {
    "tuning": (tuning, ("tuning_grid",)),
    "grid": (grid, ("tuning_grid",)),
    "learning": (learning, ("ablation_results",)),
    "parts": (parts, ("ablation_results",)),
    "three_simulators": (three_simulators, ("pure_manip_results",)),
    "one_agent": (one_agent, ("one_agent_results",)),
    "mobile": (mobile, ("mobile_manip_results",)),
}


def main() -> None:
    """Renew or check the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--read", type=Path, nargs="+", default=[], help="run folders")
    args = pages.arguments(parser)
    for run in args.read:
        draw(read_run(run, args.docs), args.docs)
    pages.renew(PAGE, TABLES, args)


if __name__ == "__main__":
    main()
