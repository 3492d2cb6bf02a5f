"""One causal discovery outside a suite, for `causalbench discover`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import Progress

from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.settings import PRESETS
from causalbench.errors import RunFolderError, UnknownNameError
from causalbench.plugins import installed
from causalbench.run.cell import use_one_thread, write_graph
from causalbench.store.files import write_text

if TYPE_CHECKING:
    from causalbench.core.discovery.oracle import StageTruth


ORACLE_STATES = 400
"""Visited states per stage that `--oracle` judges by."""


def discover_alone(
    task: str, backend: str, discoverer: str, preset: str, seed: int, oracle: bool, folder: Path
) -> tuple[CausalGraph, tuple[StageTruth, ...] | None]:
    """Discover in this process with progress on stderr, write `graph.json` and `kl.csv` into `folder`.

    With `oracle` also find the graded truth, and write `oracle.csv` and `score.csv`.
    """
    if preset not in PRESETS:
        raise UnknownNameError("preset", preset, PRESETS)
    plugins = installed()
    chosen_task, make_scene = plugins.task(task), plugins.backend(backend).make
    settings = replace(PRESETS[preset], discoverer=plugins.discoverer(discoverer).name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunFolderError(f"{folder}: cannot be written ({error.strerror}); choose another with --out") from error
    from causalbench.core.discovery.pipeline import discover

    use_one_thread()
    with Progress(console=Console(stderr=True)) as bar:
        line = bar.add_task("discovering", total=1.0)
        graph = discover(
            chosen_task, make_scene, settings, seed,
            lambda share, text: bar.update(line, completed=share, description=text),
            discoverers=plugins.discoverers,
        )  # fmt: skip
        bar.update(line, completed=1.0, description="done")
    write_graph(folder, graph)
    if not oracle:
        return graph, None
    from causalbench.core.discovery.oracle import consult_oracle
    from causalbench.core.discovery.tables import oracle_table, score_table

    with Progress(console=Console(stderr=True)) as bar:
        line = bar.add_task("oracle", total=1.0)
        truth = consult_oracle(
            chosen_task, make_scene, ORACLE_STATES, seed,
            lambda share, text: bar.update(line, completed=share, description=text),
        )  # fmt: skip
    for name, table in (("oracle.csv", oracle_table(graph, truth)), ("score.csv", score_table(graph, truth))):
        write_text(folder / name, table.to_csv(index=False, lineterminator="\n"))
    return graph, truth
