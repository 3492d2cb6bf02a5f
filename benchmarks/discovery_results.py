"""The tables of docs/discovery_results.md, from the CSV files in docs/data alone.

    python benchmarks/discovery_results.py                       # write them into the page
    python benchmarks/discovery_results.py --check               # fail if the page says something else
    python benchmarks/discovery_results.py --read runs/discoveries   # first renew what is read from discoveries
    python benchmarks/discovery_results.py --cheap RUNFOLDER...      # first renew cells of suites/cheap_discovery.yaml

The other benchmarks write the other files; one that is not there is "not measured".
"""

from __future__ import annotations

import argparse
import itertools
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pages
import pandas as pd
import yaml
from discoveries import BACKENDS, Row, existing, judged, read_graph, read_truth
from discovery_calibration import FDR, p_values_of_absent_edges
from discovery_calibration import summary as calibration_summary
from discovery_methods import summary as methods_summary
from pages import Frames, Tables, merge_into, rounded

from causalbench.core.discovery.graph import manual_graph
from causalbench.core.discovery.methods.kl.select import select_causal_actions
from causalbench.core.discovery.truth.score import score_matrix
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.report.figures import write_figures
from causalbench.report.stats import bootstrap_interval, wilson

PAGE = Path("docs/discovery_results.md")


def read_discoveries(root: Path, docs: Path) -> None:
    """Renew every edge of every discovery in `root`, and its row; discoveries that are not there keep theirs."""
    seeds = [
        (backend, int(path.name.rpartition("-s")[2]))
        for backend in BACKENDS
        for path in sorted(root.glob(f"{backend}-s*"))
    ]
    made = [(*one, path) for one in seeds if (path := existing(root, *one))]
    tables = {"discovery_edges": _edges, "discovery_seeds": _seeds, "discovery_directions": _directions}
    for name, rows in tables.items():
        new = pd.DataFrame([row for one in made for row in rows(*one)])
        merge_into(docs / f"{name}.csv", new, ("backend", "seed"))


def read_cheap(run: Path, docs: Path) -> None:
    """Renew the cells of a run in cheap_discovery.csv; `discoverer` is "none" for a method without a graph."""
    discoverer = yaml.safe_load((run / "suite.yaml").read_text(encoding="utf-8"))["discovery"]["discoverer"]
    new = pd.read_csv(run / "results.csv")
    new.insert(3, "discoverer", np.where(new["discovery_env_steps"] > 0, discoverer, "none"))
    merge_into(docs / "cheap_discovery.csv", new, ("backend", "method", "discoverer", "seed"))


def draw_first(root: Path, figures: Path) -> None:
    """The KL map of each backend's seed 0 as docs/figures/kl-BACKEND.svg."""
    figures.mkdir(parents=True, exist_ok=True)
    for backend in BACKENDS:
        if made := existing(root, backend, 0):
            with tempfile.TemporaryDirectory() as folder:
                write_figures(Path(folder) / "figures", read_graph(made), manual_graph(TASK))
                shutil.copyfile(Path(folder) / "figures" / "evidence.svg", figures / f"kl-{backend}.svg")


def _edges(backend: str, seed: int, path: Path) -> list[Row]:
    graph, rows = read_graph(path), []
    for found, true in zip(graph.stages, read_truth(path), strict=True):
        kl, grades = found.evidence["kl"], true.grades()
        for j, term in enumerate(found.terms):
            for k, action in enumerate(found.actions):
                row = Row(backend=backend, seed=seed, stage=found.stage, reward=term, action=action)
                row |= {"kl": kl[k, j], "kl_n": found.evidence["kl_normalised"][k, j]}
                row |= {
                    "largest_null": found.evidence["null_kl"][:, j].max(),
                    "q_value": found.evidence["q_value"][k, j],
                }
                row |= {"selected": int(found.matrix[k, j]), "effect": true.effect[k, j]}
                row |= {"effect_low": true.low[k, j], "effect_high": true.high[k, j], "grade": grades[k][j].value}
                rows.append(row)
    return rows


def _seeds(backend: str, seed: int, path: Path) -> list[Row]:
    graph = read_graph(path)
    scores = {row["stage"]: row["f1"] for row in graph.oracle["scores"]}
    row = Row(backend=backend, seed=seed, env_steps=graph.env_steps, oracle_env_steps=graph.oracle["env_steps"])
    return [row | {f"f1_stage_{i}": scores[str(i)] for i in range(1, 5)} | judged(graph, read_truth(path))]


def _directions(backend: str, seed: int, path: Path) -> list[Row]:
    """Algorithm 2 alone, without the gate of placebos, on each direction of KL from the same fit."""
    rows = []
    for found, true in zip(read_graph(path).stages, read_truth(path), strict=True):
        for name in ("forward", "reverse", "symmetric"):
            lists = found.evidence[f"kl_{name}"].clip(min=0.0).T
            score = score_matrix(np.column_stack([select_causal_actions(kls).selected for kls in lists]), true.grades())
            counts = {"found": score.true_positives, "missed": score.false_negatives, "false": score.false_positives}
            rows.append(Row(backend=backend, seed=seed, stage=found.stage, direction=name) | counts)
    return rows


# One function a table of the page.


def matrices(frames: Frames) -> pd.DataFrame:
    """Causes by stage, term and backend; with the seeds that found it where not all did."""
    edges = frames["discovery_edges"]

    def causes(here: pd.DataFrame) -> str:
        seeds, order = here["seed"].nunique(), list(dict.fromkeys(here["action"]))
        found = here.groupby("action")["selected"].sum()
        named = [a if found[a] == seeds else f"{a} ({found[a]} of {seeds})" for a in order if found[a]]
        return ", ".join(named)

    table = edges.groupby(["stage", "reward", "backend"], sort=False)[["action", "seed", "selected"]].apply(causes)
    order = pd.MultiIndex.from_frame(edges[["stage", "reward"]].drop_duplicates())
    wide = table.unstack("backend").loc[order].reset_index()
    seeds = edges.groupby("backend", sort=False)["seed"].nunique()
    return wide[["stage", "reward", *seeds.index]].rename(
        columns={b: f"{b}, {n} seed{'s' * (n > 1)}" for b, n in seeds.items()}
    )


def maps(frames: Frames) -> pd.DataFrame:
    """Where the pictures are."""
    first = frames["discovery_edges"].query("seed == 0")["backend"].unique()
    return pd.DataFrame({"backend": first, "KL of every edge, seed 0": [f"[map](figures/kl-{b}.svg)" for b in first]})


def scores(frames: Frames) -> pd.DataFrame:
    """F1 by backend with an interval over seeds, and the edges behind it with Wilson intervals."""
    rows = []
    for backend, here in frames["discovery_seeds"].groupby("backend", sort=False):
        edges = frames["discovery_edges"].query("backend == @backend")
        strong, absent = edges[edges["grade"] == "strong"], edges[edges["grade"] == "absent"]
        row = Row(backend=backend, seeds=len(here), **{"F1, stages 1-3": _mean(here["f1_stages_1_3"])})
        row |= {"F1, stage 4": _mean(here["f1_stage_4"]), "F1, all": _mean(here["f1"])}
        row |= {"strong edges found, stages 1-3": _share(strong[strong["stage"] < 4], "selected")}
        row |= {"strong edges found, stage 4": _share(strong[strong["stage"] == 4], "selected")}
        rows.append(row | {"absent edges selected": _share(absent, "selected")})
    return pd.DataFrame(rows)


def selections(frames: Frames) -> pd.DataFrame:
    """Edges that Algorithm 2 and the placebos' cut select from the same fits, by the oracle's grade."""
    edges = frames["discovery_edges"]
    cuts = {"paper": edges["selected"], "fdr": (edges["q_value"] <= FDR).astype(int)}
    rows = []
    for backend in dict.fromkeys(edges["backend"]):
        for name, chosen in cuts.items():
            row = Row(backend=backend, select=name)
            for grade in ("strong", "weak", "absent"):
                here = chosen[(edges["backend"] == backend) & (edges["grade"] == grade)]
                row[grade] = f"{here.sum()} of {len(here)}"
            rows.append(row)
    return pd.DataFrame(rows)


def directions(frames: Frames) -> pd.DataFrame:
    """Strong edges missed and absent ones selected by each direction of KL."""
    table = frames["discovery_directions"]
    rows = []
    for (backend, direction), here in table.groupby(["backend", "direction"], sort=False):
        row = Row(backend=backend, KL=direction)
        for name, part in (("stages 1-3", here[here["stage"] < 4]), ("stage 4", here[here["stage"] == 4])):
            strong = part["found"].sum() + part["missed"].sum()
            row[f"missed, {name}"] = f"{part['missed'].sum()} of {strong}"
            row[f"false, {name}"] = part["false"].sum()
        rows.append(row)
    return pd.DataFrame(rows)


def _mean(values: pd.Series) -> str:
    if len(values) < 5:  # as in a leaderboard
        return f"{values.mean():.2f}"
    low, high = bootstrap_interval(lambda strata: strata[0].mean(-1), [values.to_numpy()])
    return f"{values.mean():.2f} [{low:.2f}, {high:.2f}]"


def _share(edges: pd.DataFrame, column: str) -> str:
    hits, n = int(edges[column].sum()), len(edges)
    low, high = wilson(hits, n) if n else (0.0, 1.0)
    return f"{hits} of {n} [{low:.2f}, {high:.2f}]"


def wrong_edges(frames: Frames) -> pd.DataFrame:
    """Strong edges that were missed and absent ones that were selected, with their KL and effect: ranges over seeds."""
    edges = frames["discovery_edges"]
    wrong = edges[((edges["grade"] == "strong") & (edges["selected"] == 0))
                  | ((edges["grade"] == "absent") & (edges["selected"] == 1))]  # fmt: skip
    keys = ["backend", "stage", "reward", "action", "grade"]
    rows = []
    for key, here in wrong.groupby(keys, sort=False):
        row = Row(zip(keys, key, strict=True))
        row |= {"wrong in seeds": " ".join(map(str, here["seed"]))}
        row |= {name: _range(here[column]) for name, column in
                (("effect", "effect"), ("KL", "kl"), ("normalised KL", "kl_n"), ("largest null KL", "largest_null"),
                 ("q-value", "q_value"))}  # fmt: skip
        rows.append(row)
    return pd.DataFrame(rows)


def _range(values: pd.Series) -> str:
    low, high = f"{values.min():.2g}", f"{values.max():.2g}"
    return low if low == high else f"{low} to {high}"


def reach_limit(frames: Frames) -> pd.DataFrame:
    """armx on r_eefz1, the edge that hangs on how many starts lie on the reach limit."""
    here = frames["discovery_edges"].query("action == 'armx' and reward == 'r_eefz1'")
    return pd.DataFrame(
        {
            "backend": backend,
            "effect": _range(e["effect"]),
            "grades": ", ".join(f"{g} {n}" for g, n in e["grade"].value_counts().items()),
            "KL": _range(e["kl"]),
            "normalised KL": _range(e["kl_n"]),
            "selected": f"{e['selected'].sum()} of {len(e)}",
        }
        for backend, e in here.groupby("backend", sort=False)
    )


def agreement(frames: Frames) -> pd.DataFrame:
    """Mean number of the matrices' cells in which two discoveries differ (SHD), within and between backends."""
    edges = frames["discovery_edges"]
    found = {
        key: here["selected"].to_numpy() for key, here in edges.groupby(["backend", "seed"], sort=False)
    }  # in the order of the table, which is the same for all
    backends = list(dict.fromkeys(backend for backend, _ in found))
    rows = []
    for one in backends:
        row: Row = {"backend": one}
        for other in backends:
            pairs = [
                int((found[a] != found[b]).sum())
                for a, b in itertools.product(found, found)
                if (a[0], b[0]) == (one, other) and a != b
            ]
            row[other] = f"{np.mean(pairs):.2f} (at most {max(pairs)})" if pairs else "one seed"
        rows.append(row)
    return pd.DataFrame(rows)


def methods(frames: Frames) -> pd.DataFrame:
    """F1, seconds, samples and environment steps by backend and method; means over seeds."""
    table = methods_summary(frames["discovery_methods"])
    names = {"f1": "F1, all", "f1_stages_1_3": "F1, stages 1-3", "cpu_seconds": "CPU seconds", "env_steps": "env steps"}
    return rounded(table, f1=2, f1_stages_1_3=2, cpu_seconds=0, samples=0, env_steps=0).rename(columns=names)


def curve(frames: Frames) -> pd.DataFrame:
    """F1 of stages 1 to 3 by size, and of all stages in brackets."""
    table = frames["discovery_curve"]
    both = table.groupby(["backend", "method", "samples"], sort=False).agg(
        early=("f1_stages_1_3", "mean"), f1=("f1", "mean"), seeds=("seed", "nunique")
    )
    cells = (
        both.apply(lambda r: f"{r.early:.2f} ({r.f1:.2f}), {r.seeds:.0f}", axis=1)
        .unstack("samples")
        .sort_index(axis=1)
        .sort_index(axis=1)
    )
    cells.columns = [f"{size:,} samples" for size in cells.columns]
    return cells.fillna("").reset_index()


def calibration(frames: Frames) -> pd.DataFrame:
    """Wrong edges among the selected, per selection."""
    table = calibration_summary(frames["discovery_calibration"])
    return rounded(table, share=3, low=3, high=3, mean_over_seeds=3)


def p_values(frames: Frames) -> pd.DataFrame:
    """How the placebos' p-values of absent edges are distributed."""
    return rounded(p_values_of_absent_edges(frames["discovery_calibration"]), share=3, low=3, high=3)


def paper(frames: Frames) -> pd.DataFrame:
    """The paper's preset and the default, per backend and seed."""
    names = ["backend", "seed", "preset", "env_steps", "f1", "f1_stages_1_3", "shd", "missed", "false", "only_here"]
    return rounded(frames["discovery_paper"][names].fillna(""), f1=2, f1_stages_1_3=2)


def motion(frames: Frames) -> pd.DataFrame:
    """Share of closing steps that end in a grasp, by fifths of each arm action's range."""
    table = frames["discovery_contact_motion"]
    fifths = [f"fifth_{i}" for i in range(1, 6)]
    names = ["-1 to -0.6", "to -0.2", "to 0.2", "to 0.6", "to 1"]
    return rounded(table, **dict.fromkeys(fifths, 3)).rename(columns=dict(zip(fifths, names, strict=True)))


def pairs(frames: Frames) -> pd.DataFrame:
    """Grasps lost and gained with an action at 0."""
    return frames["discovery_contact_pairs"]


def inputs(frames: Frames) -> pd.DataFrame:
    """What each action says of the grasp, by the classifier with all samples."""
    table = frames["discovery_contact_inputs"]
    table = table[table["samples"] > 3_000]
    interval = [f"{n:.4f} [{lo:.4f}, {hi:.4f}]" for n, lo, hi in table[["nats", "nats_low", "nats_high"]].to_numpy()]
    return table.assign(nats=interval).drop(columns=["nats_low", "nats_high"]).round(3)


def sufficiency(frames: Frames) -> pd.DataFrame:
    """Starts of 50 that the expert solves with the discovered actions, and with one dropped."""
    table = frames["discovery_sufficiency"]
    rows = []
    for (backend, seeds, stage, actions), here in table.groupby(["backend", "seeds", "stage", "actions"], sort=False):
        solved = dict(zip(here["dropped"], here["solved"], strict=True))
        whole = solved.pop("none")
        row = Row(backend=backend, seeds=seeds, stage=stage, actions=actions, solved=whole)
        rows.append(row | {"without": ", ".join(f"{action} {n}" for action, n in solved.items())})
    return pd.DataFrame(rows)


def cheap(frames: Frames) -> pd.DataFrame:
    """cmSAC on cheaply discovered graphs against mSAC, per seed."""
    table = frames["cheap_discovery"]
    table = table.assign(steps_to_90_with_discovery=table["steps_to_90"] + table["discovery_env_steps"])
    names = ["backend", "method", "discoverer", "seed", "env_steps", "discovery_env_steps", "success_deterministic",
             "held_rate", "success_auc", "steps_to_90", "steps_to_90_with_discovery",
             "reversals_per_1000_steps"]  # fmt: skip
    steps = dict.fromkeys(("steps_to_90", "steps_to_90_with_discovery"), 0)
    return rounded(table[names].round(3), **steps).fillna("")


TABLES: Tables = {
    "matrices": (matrices, ("discovery_edges",)),
    "maps": (maps, ("discovery_edges",)),
    "scores": (scores, ("discovery_edges", "discovery_seeds")),
    "selections": (selections, ("discovery_edges",)),
    "directions": (directions, ("discovery_directions",)),
    "wrong_edges": (wrong_edges, ("discovery_edges",)),
    "reach_limit": (reach_limit, ("discovery_edges",)),
    "agreement": (agreement, ("discovery_edges",)),
    "methods": (methods, ("discovery_methods",)),
    "curve": (curve, ("discovery_curve",)),
    "calibration": (calibration, ("discovery_calibration",)),
    "p_values": (p_values, ("discovery_calibration",)),
    "paper": (paper, ("discovery_paper",)),
    "motion": (motion, ("discovery_contact_motion",)),
    "pairs": (pairs, ("discovery_contact_pairs",)),
    "inputs": (inputs, ("discovery_contact_inputs",)),
    "sufficiency": (sufficiency, ("discovery_sufficiency",)),
    "cheap": (cheap, ("cheap_discovery",)),
}


def main() -> None:
    """Renew or check the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--read", type=Path, help="folder that discoveries.py filled")
    parser.add_argument("--cheap", type=Path, nargs="+", default=[], help="run folders of suites/cheap_discovery.yaml")
    args = pages.arguments(parser)
    if args.read:
        read_discoveries(args.read, args.docs)
        draw_first(args.read, args.docs.parent / "figures")
    for run in args.cheap:
        read_cheap(run, args.docs)
    pages.renew(PAGE, TABLES, args)


if __name__ == "__main__":
    main()
