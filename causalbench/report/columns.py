"""The data dictionary: what each column of each CSV file means, and the columns of each file in order.

A name means the same in every file. `docs/reference/make.py` makes `docs/reference/tables.md` of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

DType = Literal["string", "Int64", "Float64"]
"""pandas' names; an empty cell of the file is a missing value."""


@dataclass(frozen=True)
class Column:
    """One column: dtype, unit ("" for a name or a share), and a sentence."""

    dtype: DType
    unit: str
    sentence: str


def _text(sentence: str) -> Column:
    return Column("string", "", sentence)


def _count(unit: str, sentence: str) -> Column:
    return Column("Int64", unit, sentence)


def _number(unit: str, sentence: str) -> Column:
    return Column("Float64", unit, sentence)


COLUMNS: dict[str, Column] = {
    # What a row is of
    "task": _text("The task's name."),
    "backend": _text('The backend\'s name; in the leaderboard and in verdicts "all" stands for all backends together.'),
    "method": _text("The method's name: a row of the method table."),
    "discoverer": _text("The name of the discoverer that decided the edge."),
    "grid_point": _text("What the suite's `grid` set in this cell, such as `learner.gamma=0.9`; empty without a grid."),
    "seed": _count("", "The seed of training and evaluation, or of a discovery."),
    "cell": _text("The cell's id, which is its folder's name."),
    "state": _text("How the cell ended: done, failed, timeout, diverged, skipped, damaged."),
    # Steps
    "env_steps": _count("environment steps", "Control steps taken so far, in all worlds together."),
    "budget": _count("environment steps", "What the suite lets a training run take; curves and areas end there."),
    "stopped_at": _count("environment steps", "Where training ended before its budget (`stop_after`); empty if not."),
    "discovery_env_steps": _count("environment steps", "What the method's causal graph cost; 0 without one."),
    # Evaluation
    "episodes": _count("episodes", "Deterministic episodes in the evaluation; a cell's last one has as many sampled."),
    "success_deterministic": _number("", "Share of episodes from stage 1 that the policy's mean action solves."),
    "success_sampled": _number(
        "",
        "The same with actions drawn from the policy: in the last evaluation, which results and the leaderboard have, "
        "over as many episodes on the same starts; before it, over the training episodes that ended since the "
        "evaluation before, while the policy learned; empty if none ended.",
    ),
    "success_low": _number("", "Lower end of the 95% Wilson interval of `success_deterministic`."),
    "success_high": _number("", "Upper end of that interval."),
    "best_success": _number("", "The highest `success_deterministic` of any evaluation."),
    "held_rate": _number(
        "", "Share of the evaluation's successes that stood the task's own test (lift and hold); empty without."
    ),
    "success_auc": _number(
        "", "Area under the curve of `success_deterministic` over `env_steps`, as a share of the budget."
    ),
    "steps_to_90": _number(
        "environment steps",
        "Training steps at the first evaluation with at least 90% deterministic success; empty if there was none. "
        "In the leaderboard the median over seeds, one that never got there counting as infinity.",
    ),
    "mean_final_stage": _number("stages", "Mean stage in which deterministic episodes end; success is one more."),
    "mean_length": _number("control steps", "Mean length of deterministic episodes."),
    "mean_return": _number("reward", "Mean undiscounted return of a deterministic episode, all terms together."),
    "mean_term_return": _number("reward", "Mean undiscounted return of one reward term in a deterministic episode."),
    "reversals_per_episode": _number("reversals", "Reversals in a deterministic episode, on average."),
    "reversals_per_1000_steps": _number("reversals", "Reversals per 1,000 environment steps of training."),
    "graph": _text("Hash of the causal graph that the method used; empty without one."),
    "source": _text("`package=hash` of the source code of causalbench and of each plugin that the cell used."),
    # Stages
    "quantity": _text(
        "What `count` counts: training episodes that reached `to_stage`, transitions (environment steps from "
        "`from_stage` to `to_stage`), or gradient updates of the agent of `to_stage`."
    ),
    "from_stage": _count("", "Stage before the step; empty where `quantity` is of one stage."),
    "to_stage": _text('Stage after the step, or the stage that `quantity` is of; "all" for an agent of all stages.'),
    "count": _count("", "How many."),
    # Episodes
    "episode": _count("", "Number of the episode in its mode, from 0; the same number has the same start everywhere."),
    "deterministic": _count("", "1 if the policy's mean action was taken, 0 if actions were drawn."),
    "success": _count("", "1 if the task's verdict was success, else 0."),
    "held": _count("", "1 if the success stood the task's own test, 0 if not; empty without success or test."),
    "n_stages": _count("stages", "Stages of the task."),
    "length": _count("control steps", "Length of the episode."),
    "reversals": _count(
        "reversals", "Steps of the episode that led to an earlier stage; in `reversals.csv` those from `stage`."
    ),
    "final_stage": _count("", "Stage after the last step; success is one more than `n_stages`."),
    "stages": _text("The stage before each step, in run-length form: `1x12 2x5` is 12 steps in stage 1, 5 in stage 2."),
    "return": _number("reward", "Undiscounted return of the episode, all terms together."),
    # Progress reversal, in the deterministic episodes of the final evaluation
    "episodes_reached": _count("episodes", "Those that reached `stage`; one more than `n_stages` is success."),
    "episodes_held": _count("episodes", "Those that reached it and never fell below it again; a success that held."),
    "episodes_fell_back": _count("episodes", "Those that reached it and fell below it; a success that did not hold."),
    "episodes_recovered": _count("episodes", "Those of them that end at or above it."),
    "episodes_lost": _count("episodes", "Those of them that end below it: lost for good."),
    "falls": _count("", "Steps from the stage or above to below it."),
    "steps_in_stage": _count("control steps", "Steps taken in just this stage."),
    "steps_below": _count("control steps", "Steps taken below the stage after it had been reached."),
    "largest_progress": _number("", "Mean of the largest share of stages that were behind at once."),
    "final_progress": _number("", "Mean of the share of stages that are behind at the end; 1 on success."),
    "regression_loss": _number(
        "", "Mean over steps of how far progress is below its peak so far, as a share of `largest_progress`."
    ),
    "path_efficiency": _number("", "Square of `largest_progress` divided by all progress travelled, up and down."),
    "largest_drawdown": _number("", "Mean of the deepest fall below the peak so far, as a share of all stages."),
    "episodes_with_drawdown": _count("episodes", "Those whose progress ever fell."),
    "drawdown_recovered": _number("", "Mean share of that fall won back, over those episodes; empty without any."),
    "rule": _text(
        "A rule that remembers: `peak_progress` was once at least `threshold`, `recorded_milestones` is the share of "
        "stages ever completed, `success_once` counts a success that does not stand the task's own test."
    ),
    "threshold": _number("", "The share of stages that `peak_progress` asks for; empty for other rules."),
    "latched": _number("", "The share by the rule."),
    "at_end": _number("", "The same bar judged at the end of the episode, a success only if it held."),
    "points": _number("percentage points", "What remembering adds: 100 (`latched` - `at_end`)."),
    # Whose doing a reversal is: the step that led to it, taken again from a snapshot
    "causes_graph": _text(
        "Hash of the graph whose causes are meant: what the run discovered on the backend, of the cell's own seed or "
        "of the lowest one, else the human's."
    ),
    "reversals_repeated": _count(
        "reversals", "Those that came again when nothing was changed: all of them where snapshots are exact."
    ),
    "vanished_without_redundant": _count(
        "reversals", "Those that did not come with every action outside the stage's causes at 0."
    ),
    "vanished_without_causes": _count("reversals", "Those that did not come with every cause of the stage at 0."),
    # Policies on other backends
    "played_on": _text("The backend on which the policy was played, as it came from training on `backend`."),
    # Leaderboard
    "rank": _count(
        "",
        "The best place that the seeds allow: one more than the methods shown to be better; empty while planned cells "
        "are not finished.",
    ),
    "worst_rank": _count("", "The worst place that the seeds allow: all methods less those shown to be worse."),
    "seeds": _count("seeds", "Seeds finished, in the leaderboard on every backend of the board."),
    "success_auc_iqm": _number("", "Interquartile mean of `success_auc` over seeds, the mean of backends; the order."),
    "success_auc_lowest": _number("", "The lowest `success_auc` of any cell of the row."),
    "success_auc_highest": _number("", "The highest one."),
    "tolerance": _number(
        "", "The share of all seeds that lies between lowest and highest, with 95% confidence; empty for `all`."
    ),
    "reached_90": _count(
        "seeds", "Cells of all backends that reached 90%; `steps_to_90` counts the others as infinity."
    ),
    "stopped_cells": _count("cells", "Cells that ended before their budget (`stop_after`)."),
    "steps_to_90_with_discovery": _number("environment steps", "`steps_to_90` and what the causal graph cost."),
    "p_better_than_next": _number("", "Probability that a seed of this method beats one of the method ranked below."),
    "failed_cells": _count("cells", "Cells that failed, diverged, timed out, were skipped or are damaged."),
    "sources": _count("", "Versions of the source code that made the cells of the board; above 1 it mixes code."),
    "verdict": _text(
        "What the seeds allow one to say: in the leaderboard in words and exploratory; of a hypothesis `better`, "
        "`worse`, `equivalent`, `not decided` or `not run`."
    ),
    # Verdicts
    "hypothesis": _text("What the suite states: `A > B`, or `A == B within` a difference of success areas."),
    "stated": _count("", "1 if it was written down before the run's first cell started, 0 if it is exploratory."),
    "measure": _text(
        "What is compared: `success_auc`, or, as a secondary measure, `steps_to_90` by the log-rank test."
    ),
    "difference": _number(
        "",
        "A less B, the mean of backends: of `success_auc`, or the environment steps to 90% that A saves in the budget.",
    ),
    "low": _number(
        "", "Lower end of the 95% interval of this difference alone, by inverting the test; empty if infinite."
    ),
    "high": _number("", "Upper end of that interval."),
    "p_value": _number(
        "",
        "Two-sided p-value: in verdicts of the test on seeds, for `==` of two one-sided tests if that is smaller; in "
        "`agreement.csv` of rankings that have nothing to do with one another.",
    ),
    "p_adjusted": _number(
        "", "The p-value by Holm's step-down for all comparisons of the measure: at most 0.05 decides."
    ),
    "n_a": _count("cells", "Finished cells of A among the planned ones."),
    "n_b": _count("cells", "Finished cells of B among the planned ones."),
    "seeds_missing": _count(
        "cells", "Planned cells of A and B that are not finished; there is no verdict unless it is 0."
    ),
    "seed_correlation": _number("", "Correlation of A and B by seed, the mean of backends; empty if undefined."),
    "paired": _count(
        "", "1 if the test took seeds as pairs, which it does from eight seeds of a correlation of 0.5 on."
    ),
    "detectable": _number(
        "", "The true difference that these seeds show with a chance of 80%; empty if so few cannot show any."
    ),
    "sentence": _text("The verdict with its evidence, in words."),
    # Looks
    "look": _count("", "Number of the look, from 1, of a run that adds seeds until its hypotheses are decided."),
    "spent": _count("seeds", "Seeds that are finished then."),
    "decided": _count("hypotheses", "Those decided by then, on all backends together where there are several."),
    "undecided": _count("hypotheses", "The others."),
    "stops": _count("", "1 if the run stops there, 0 if it goes on."),
    "reason": _text("Why it stops or goes on."),
    # Whether backends agree
    "other_backend": _text("The backend that `backend` is compared with."),
    "methods": _count("methods", "Methods of which every planned cell is finished on both backends."),
    "kendall_tau": _number("", "Kendall's rank correlation (tau-b) of the methods' areas on the two backends."),
    # Discovery
    "stage": _text('The stage, from 1; "all" for the whole graph.'),
    "term": _text("The reward term."),
    "action": _text("The action."),
    "outcome": _text("What the discovery says of the edge: present, absent or undecided."),
    "selected": _count("", "1 where the discovery says that the action causes the term, else 0."),
    "in_policy": _count("", "1 where a policy sets the action in this stage, else 0."),
    "effect": _number("", "Share of the term's variance that the action causes, as the oracle measures it."),
    "effect_low": _number("", "Lower end of its 95% interval."),
    "effect_high": _number("", "Upper end of that interval."),
    "floor": _number("", "The effect that repeating the same action shows: 0 where the simulator restores exactly."),
    "grade": _text("The oracle's grade of the edge: absent, weak, strong, or untestable where the term never varies."),
    "oracle_effect": _number("", "`effect` of the edge, beside what was discovered; empty without an oracle."),
    "oracle_effect_low": _number("", "`effect_low` of the edge."),
    "oracle_effect_high": _number("", "`effect_high` of the edge."),
    "oracle_grade": _text("`grade` of the edge."),
    "precision": _number("", "Share of selected edges that are strong, among strong and absent ones."),
    "recall": _number("", "Share of strong edges that were selected."),
    "f1": _number("", "Harmonic mean of precision and recall."),
    "shd": _count("edges", "Structural Hamming distance: edges that would have to be added or removed."),
    "f1_weak_present": _number("", "F1 with weak edges counted as present."),
    "left_undecided": _count("edges", "Edges that the discovery left undecided; those that are there count as missed."),
    # Time
    "seconds": _number("s", "Wall-clock time that the cell took."),
    "env_steps_per_second": _number("1/s", "`env_steps` over `seconds`."),
}

KEYS = ("task", "backend", "method", "grid_point", "seed")
EDGE_KEYS = (
    "task", "backend", "discoverer", "grid_point", "seed",
    "stage", "term", "action", "outcome", "selected", "in_policy",
)  # fmt: skip
EFFECT = ("effect", "effect_low", "effect_high")
REVERSALS = (
    "episode", "deterministic", "stage", "steps_in_stage", "reversals", "reversals_repeated",
    "vanished_without_redundant", "vanished_without_causes", "causes_graph",
)  # fmt: skip
TRANSFER = (
    "played_on", "episodes", "success_deterministic", "success_sampled", "reversals_per_episode", "mean_final_stage",
)  # fmt: skip

TABLES: dict[str, tuple[str, ...]] = {
    "results.csv": (
        *KEYS, "budget", "success_auc", "steps_to_90", "stopped_at", "env_steps", "discovery_env_steps", "episodes",
        "success_deterministic", "success_sampled", "success_low", "success_high", "best_success", "held_rate",
        "mean_final_stage", "reversals_per_episode", "reversals_per_1000_steps", "mean_return", "graph", "source",
    ),
    "curves.csv": (
        *KEYS, "env_steps", "success_deterministic", "success_sampled", "reversals_per_episode", "mean_final_stage",
    ),
    "returns.csv": (*KEYS, "env_steps", "term", "mean_term_return"),
    "stages.csv": (*KEYS, "quantity", "from_stage", "to_stage", "count"),
    "episodes.csv": (
        *KEYS, "episode", "deterministic", "success", "held", "n_stages", "length", "reversals", "final_stage",
        "stages", "return",
    ),
    "stage_account.csv": (
        *KEYS, "stage", "episodes", "episodes_reached", "episodes_held", "episodes_fell_back", "episodes_recovered",
        "episodes_lost", "falls", "steps_in_stage", "steps_below",
    ),
    "moves.csv": (*KEYS, "from_stage", "to_stage", "count"),
    "progress_account.csv": (
        *KEYS, "episodes", "largest_progress", "final_progress", "regression_loss", "path_efficiency",
        "largest_drawdown", "episodes_with_drawdown", "drawdown_recovered",
    ),
    "reversals.csv": (*KEYS, *REVERSALS),
    "transfer.csv": (*KEYS, *TRANSFER),
    "latching.csv": (*KEYS, "rule", "threshold", "latched", "at_end", "points"),
    "discovery.csv": (*EDGE_KEYS, *(f"oracle_{name}" for name in EFFECT), "oracle_grade"),
    "leaderboard.csv": (
        "rank", "worst_rank", "method", "grid_point", "backend", "seeds", "budget", "success_auc_iqm",
        "success_auc_lowest", "success_auc_highest", "tolerance", "steps_to_90", "reached_90",
        "steps_to_90_with_discovery", "success_deterministic", "success_sampled", "best_success", "held_rate",
        "reversals_per_1000_steps", "stopped_cells", "p_better_than_next", "failed_cells", "sources", "verdict",
    ),
    "verdicts.csv": (
        "hypothesis", "stated", "backend", "measure", "verdict", "difference", "low", "high", "p_value", "p_adjusted",
        "n_a", "n_b", "seeds_missing", "seed_correlation", "paired", "detectable", "sentence",
    ),
    "looks.csv": ("look", "spent", "decided", "undecided", "stops", "reason"),
    "agreement.csv": ("backend", "other_backend", "methods", "kendall_tau", "p_value"),
    "timing.csv": ("cell", "state", "seconds", "env_steps", "env_steps_per_second"),
    "cells/*/progress.csv": (
        "env_steps", "episodes", "success_deterministic", "success_sampled", "held_rate", "reversals_per_episode",
        "mean_final_stage", "mean_length",
    ),
    "cells/*/episodes.csv": (
        "episode", "deterministic", "success", "held", "n_stages", "length", "reversals", "final_stage", "stages",
        "return",
    ),
    "cells/*/reversals.csv": REVERSALS,
    "cells/*/transfer.csv": TRANSFER,
    "discovery/*/evidence.csv": ("stage", "term", "action", "outcome", "selected", "in_policy"),
    "discovery/*/oracle.csv": ("stage", "term", "action", *EFFECT, "floor", "grade", "outcome", "selected"),
    "discovery/*/score.csv": ("stage", "precision", "recall", "f1", "shd", "f1_weak_present", "left_undecided"),
}  # fmt: skip
"""File -> its columns, in order. What else a file has is said in `FURTHER`."""

FURTHER = {
    "episodes.csv": "Then `return_<term>` for each reward term.",
    "cells/*/episodes.csv": "Then `return_<term>` for each reward term.",
    "discovery.csv": "Then the evidence of the discoverers, as `evidence.csv` has it.",
    "cells/*/progress.csv": "Then `return_<term>` for each reward term: see `mean_term_return`.",
    "discovery/*/evidence.csv": "Then the columns that the discoverer describes in `graph.json`, each with a sentence.",
}

PAGE = """\
# Tables

Made by `python docs/reference/make.py` from [columns.py](../../causalbench/report/columns.py).

This page says what every column of every CSV file of a run means. A name has the same meaning in all files. An
empty cell is a missing value. `causalbench.load_results(folder)` returns the files of a run as pandas frames with
these dtypes.
"""


def page() -> str:
    """The page `docs/reference/tables.md`."""
    parts = [PAGE]
    for file, names in TABLES.items():
        parts.append(f"\n## {file}\n\n| column | dtype | unit | |\n|---|---|---|---|\n")
        columns = ((name, COLUMNS[name]) for name in names)
        parts += [f"| `{name}` | {found.dtype} | {found.unit} | {found.sentence} |\n" for name, found in columns]
        parts.append(f"\n{FURTHER[file]}\n" if file in FURTHER else "")
    return "".join(parts)
