"""What a run left behind, for tests that compare runs."""

from __future__ import annotations

from pathlib import Path

RESULT_FILES = (
    "results.csv", "curves.csv", "returns.csv", "stages.csv", "episodes.csv", "stage_account.csv", "moves.csv",
    "progress_account.csv", "latching.csv", "discovery.csv", "leaderboard.csv",
    "verdicts.csv", "agreement.csv", "looks.csv", "hypotheses.json", "reversals.csv", "transfer.csv",
)  # fmt: skip
NO_RESULT = ("status.json", "log.txt", "checkpoint.safetensors")
"""The files of a cell that hold times, or serve to go on."""


def results(run: Path) -> dict[str, bytes]:
    """Every file of a run that holds a result: the tables, and all of each cell but times and checkpoints."""
    paths = [run / name for name in RESULT_FILES]
    paths += [path for kind in ("cells", "discovery") for path in run.glob(f"{kind}/**/*") if path.is_file()]
    return {str(path.relative_to(run)): path.read_bytes() for path in sorted(paths) if path.name not in NO_RESULT}
