"""What a run folder holds. Not a table of columns: those of each CSV stand in `report/columns.py`."""

from __future__ import annotations

CELL_FILES = {
    "cell.json": "The cell's identity: all that can change its numbers. Its hash is in the folder's name.",
    "status.json": "How it ended (`done`, `failed`, `timeout`, `diverged`, `skipped`) or stands, and why, "
    "how long it took, the hash of the code, and the SHA-256 of each result file. Written last.",
    "log.txt": "What the cell and its simulator printed, at most 4 MB.",
    "progress.json": "How far a cell that runs is, for `causalbench status`; removed when it ends.",
}  # fmt: skip
"""In the folder of every cell."""

FILES = {
    "suite.yaml": "The suite that the last command ran, as it was read.",
    "run.json": "Marks the folder as ours, with the number of its format.",
    "environment.json": "Of each session: command, versions, CPU, git state, known gaps of its backends.",
    "hypotheses.json": "What each plan stated before its first cell, with its hash.",
    **{f"cells/*/{name}": sentence for name, sentence in CELL_FILES.items()},
    "cells/*/progress.csv": "One row per evaluation during training.",
    "cells/*/episodes.csv": "Every episode of the final evaluation, with its stages step by step.",
    "cells/*/counts.json": "What training counted: steps, stages reached, moves, reversals, updates, the graph's hash.",
    "cells/*/policy/*": "The trained policy, for `causalbench.load_policy`; nothing in it is unpickled.",
    "cells/*/reversals.csv": "Whose doing its reversals are, by `causalbench reversals`.",
    "cells/*/transfer.csv": "How its policy does on other backends, by `causalbench transfer`.",
    "cells/*/checkpoint.safetensors": "What a killed training, or a larger budget, goes on from; may be deleted.",
    "cells/*/tensorboard/*": "Curves for TensorBoard, with `run --tensorboard`.",
    **{f"discovery/*/{name}": sentence for name, sentence in CELL_FILES.items()},
    "discovery/*/graph.json": "The causal graph with its evidence and settings, for `causalbench.load_graph`.",
    "discovery/*/manual.json": "The graph that the task's author declared.",
    "discovery/*/evidence.csv": "One row per edge, with what the discoverer measured.",
    "discovery/*/oracle.csv": "One row per edge, with what counterfactuals say, where `oracle_states` is not 0.",
    "discovery/*/score.csv": "Precision, recall, F1 and the like against the oracle.",
    "discovery/*/data/*": "The samples of each stage, for `causalbench discover --data`.",
    "discovery/*/figures/*": "Pictures of the matrix, the evidence and the graph.",
    "results.csv": "One row per trained agent.",
    "curves.csv": "Success over environment steps.",
    "returns.csv": "Mean return of each reward term over environment steps.",
    "stages.csv": "Stages reached and left in training.",
    "episodes.csv": "Every final episode.",
    "stage_account.csv": "What became of each stage that an episode entered.",
    "moves.csv": "Moves from stage to stage in final episodes.",
    "progress_account.csv": "How far episodes got, and how much they lost again.",
    "latching.csv": "What rules that remember would add to success.",
    "reversals.csv": "The reversals of final policies taken again without some actions, by `causalbench reversals`.",
    "transfer.csv": "Policies played on other backends, by `causalbench transfer`.",
    "discovery.csv": "One row per edge of every graph, with the evidence.",
    "verdicts.csv": "What was stated before the run, judged.",
    "looks.csv": "What `--until-decided` decided after which seeds.",
    "agreement.csv": "Whether backends rank methods alike.",
    "leaderboard.csv": "One row per method and backend: exploratory.",
    "leaderboard.md": "The same for a README, by `causalbench report`.",
    "leaderboard.tex": "The same for a paper, by `causalbench report`.",
    "timing.csv": "How long each cell took: the only table with times.",
    "report.html": "All of it on one page, to be opened from disk.",
    "figures/*": "Pictures for a paper, by `causalbench report`.",
    "videos/*": "Films of trained policies, by `causalbench play`.",
    ".slurm/*": "Output of the jobs of `--executor slurm`.",
    ".lock": "Held while a command writes here.",
    ".holder.json": "Which process on which machine that is; removed when it ends.",
}  # fmt: skip
"""Where a file lies, from the run folder on -> what it says."""
