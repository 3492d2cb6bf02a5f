"""One causal discovery outside a suite, for `causalbench discover`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import Progress

from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.settings import PRESETS, DiscoverySettings
from causalbench.errors import RunFolderError, UnknownNameError
from causalbench.plugins import installed, scene_maker
from causalbench.run.cell import use_one_thread, write_graph
from causalbench.store.cells import DATA
from causalbench.store.files import write_text
from causalbench.store.samples import SampleFolder

if TYPE_CHECKING:
    from causalbench.core.discovery.oracle import StageTruth


ORACLE_STATES = 400
"""Visited states per stage that `--oracle` judges by."""


def discover_alone(
    task: str, backend: str, discoverer: str, preset: str, seed: int, oracle: bool, folder: Path, cores: int
) -> tuple[CausalGraph, tuple[StageTruth, ...] | None]:
    """Discover in this process with progress on stderr, write `graph.json`, the numbers behind it and the samples.

    Samples that an interrupted call left in `folder` are used. With `oracle` also find the graded truth, and write
    `oracle.csv` and `score.csv`.
    """
    plugins, settings = installed(), _settings(discoverer, preset)
    chosen_task = plugins.task(task)
    make_scene = scene_maker(plugins.backend(backend), chosen_task)
    _make(folder)
    from causalbench.core.discovery.pipeline import discover

    use_one_thread()
    with _progress("discovering") as report:
        graph = discover(
            chosen_task, make_scene, settings, seed, report,
            discoverers=plugins.discoverers, cores=cores, store=SampleFolder(folder / DATA),
        )  # fmt: skip
    write_graph(folder, graph)
    if not oracle:
        return graph, None
    from causalbench.core.discovery.oracle import consult_oracle
    from causalbench.core.discovery.tables import oracle_table, score_table

    with _progress("oracle") as report:
        truth = consult_oracle(chosen_task, make_scene, ORACLE_STATES, seed, report)
    for name, table in (("oracle.csv", oracle_table(graph, truth)), ("score.csv", score_table(graph, truth))):
        write_text(folder / name, table.to_csv(index=False, lineterminator="\n"))
    return graph, truth


def infer_alone(data: Path, discoverer: str, preset: str, folder: Path) -> CausalGraph:
    """Discover from the samples in the folder `data`, with their task, seed and sizes; imports no simulator."""
    plugins, settings = installed(), _settings(discoverer, preset)
    store = SampleFolder(data)
    origin, about = store.origin()
    settings = replace(
        settings,
        training_count=about["count"],
        **{name: about[name] for name in ("inference_fraction", "sequence_length", "n_placebos")},
    )
    task = plugins.task(about["task"])
    _make(folder)
    from causalbench.core.discovery.pipeline import discover_from_samples

    use_one_thread()
    with _progress("discovering") as report:
        graph = discover_from_samples(
            task, store, origin, settings, about["seed"], report, discoverers=plugins.discoverers
        )
    write_graph(folder, graph)
    return graph


def _settings(discoverer: str, preset: str) -> DiscoverySettings:
    if preset not in PRESETS:
        raise UnknownNameError("preset", preset, PRESETS)
    return replace(PRESETS[preset], discoverer=installed().discoverer(discoverer).name)


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunFolderError(f"{folder}: cannot be written ({error.strerror}); choose another with --out") from error


@contextmanager
def _progress(title: str) -> Iterator[Callable[[float, str], None]]:
    """A bar with the time left on stderr, and the function that moves it."""
    with Progress(console=Console(stderr=True)) as bar:
        line = bar.add_task(title, total=1.0)
        yield lambda share, text: bar.update(line, completed=share, description=text)
        bar.update(line, completed=1.0, description="done")
