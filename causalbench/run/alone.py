"""One causal discovery outside a suite, for `causalbench discover`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import Progress

from causalbench.core.discovery.graph import CausalGraph, manual_graph
from causalbench.core.discovery.settings import SHARED, DiscoverySettings
from causalbench.errors import RunFolderError, UserError
from causalbench.plugins.manager import installed, scene_maker
from causalbench.run.cell import use_one_thread, write_graph
from causalbench.run.score_graph import judge_graph
from causalbench.store.cells import DATA
from causalbench.store.samples import SampleFolder
from causalbench.suite.sections import DiscoverySection

if TYPE_CHECKING:
    from causalbench.core.discovery.truth.oracle import StageTruth


def discover_alone(
    task: str, backend: str, settings: DiscoverySettings, seed: int, oracle: bool, folder: Path, cores: int
) -> tuple[CausalGraph, tuple[StageTruth, ...] | None]:
    """Discover in this process with progress on stderr, write `graph.json`, the numbers behind it and the samples.

    Samples that an interrupted call left in `folder` are used. With `oracle` also find the graded truth, and write
    `oracle.csv` and `score.csv`.
    """
    plugins = installed()
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
    human = manual_graph(chosen_task)
    write_graph(folder, graph, human)
    if not oracle:
        return graph, None
    from causalbench.core.discovery.truth.oracle import ORACLE_STATES

    with _progress("oracle") as report:
        graph, truth = judge_graph(graph, chosen_task, make_scene, ORACLE_STATES, seed, folder, report)
    write_graph(folder, graph, human)
    return graph, truth


def infer_alone(data: Path, settings: DiscoverySettings, folder: Path) -> CausalGraph:
    """Discover from the samples in the folder `data`, with their task, seed and sizes; imports no simulator."""
    plugins, store = installed(), SampleFolder(data)
    origin, about = store.origin()
    settings = replace(
        settings,
        training_count=about["count"],
        action_repeat=about.get("action_repeat", 1),
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
    write_graph(folder, graph, manual_graph(task))
    return graph


def choose_settings(discoverer: str, preset: str, changed: Mapping[str, Any]) -> DiscoverySettings:
    """Those of a preset with the settings in `changed`, shared ones or the discoverer's own. Raises `UserError`."""
    chosen, section = installed().discoverer(discoverer), DiscoverySection(installed().discoverers)
    shared = {key: value for key, value in changed.items() if key in SHARED}
    own = {key: value for key, value in changed.items() if key not in SHARED}
    settings = chosen.configure(preset, shared, own)  # refuses names that do not exist
    if problem := section.shared.problem(shared) or section.own[discoverer].problem(own):
        location, what = problem
        raise UserError(f"--set {location[0]}: {what}")
    return settings


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
