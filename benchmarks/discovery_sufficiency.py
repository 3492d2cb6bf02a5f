"""Complete yet non-redundant, on the discovered graphs: the scripted expert with a stage's causal actions alone.

    python benchmarks/discovery_sufficiency.py

50 starts of every stage, with all causal actions and with each of them dropped in turn. Seeds that found the same sets
share a row.
"""

from __future__ import annotations

from collections import defaultdict
from functools import partial
from pathlib import Path

from discoveries import BACKENDS, Row, folder, measured, options, put_together, read_graph

from causalbench.core.staged.restricted_expert import STARTS, solved_starts
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.core.world.batch import make_batch
from causalbench.plugins.manager import installed

NAME = "discovery_sufficiency"
Sets = tuple[tuple[str, ...], ...]  # causal actions by stage


def discovered_sets(backend: str, seeds: list[int], discoveries: Path) -> dict[Sets, list[int]]:
    """The seeds of every distinct result."""
    found: dict[Sets, list[int]] = defaultdict(list)
    for seed in seeds:
        graph = read_graph(folder(discoveries, backend, seed))
        found[tuple(stage.causal_actions() for stage in graph.stages)].append(seed)
    return found


def rows_of(backend: str, seeds: list[int], discoveries: Path) -> list[Row]:
    """A row per distinct result, stage and dropped action ("none": none)."""
    batch = make_batch(installed().backend(backend).make, STARTS if backend == "kinematic" else 1)
    rows = []
    for sets, which in discovered_sets(backend, seeds, discoveries).items():
        for stage, actions in enumerate(sets, 1):
            for dropped in ("none", *actions):
                allowed = {i: set(s) - ({dropped} if i == stage else set()) for i, s in enumerate(sets, 1)}
                row = Row(backend=backend, seeds=" ".join(map(str, which)), stage=stage, actions=" ".join(actions))
                rows.append(row | {"dropped": dropped, "solved": int(solved_starts(TASK, batch, stage, allowed).sum())})
                print(rows[-1], flush=True)
    batch.close()
    return rows


def main() -> None:
    """Measure what is missing and print the table."""
    args = options(__doc__, NAME, BACKENDS, 5).parse_args()
    for backend in args.backends:
        measured(args.work / f"{backend}.csv", partial(rows_of, backend, [*args.seeds], args.discoveries))
    print(put_together(args.work, NAME, args.docs, ("backend",)).to_string(index=False))


if __name__ == "__main__":
    main()
