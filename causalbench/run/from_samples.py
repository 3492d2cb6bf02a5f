"""A causal discovery from the samples of an earlier one: no simulator, and so no cell of a suite."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress

from causalbench.core.discovery.graph import CausalGraph, manual_graph
from causalbench.core.discovery.settings import DiscoverySettings
from causalbench.errors import UserError
from causalbench.plugins.manager import Plugins, installed
from causalbench.run.cell import use_one_thread, write_graph
from causalbench.store.claim import claim
from causalbench.store.samples import SampleFolder
from causalbench.suite.sections import Sections


def discover_from_folder(data: Path, section: Mapping[str, Any], folder: Path) -> CausalGraph:
    """Discover from the samples in the folder `data`, with their task, seed and sizes; imports no simulator.

    `section` is a suite's section `discovery`. Writes graph.json and the numbers behind it into `folder`. Raises
    `UserError` for a wrong setting or no samples, and `RunFolderError` for a folder that cannot be written.
    """
    plugins, store = installed(), SampleFolder(data)
    origin, about = store.origin()
    settings = _settings(section, about, plugins)
    task = plugins.task(about["task"])
    from causalbench.core.discovery.pipeline import discover_from_samples

    use_one_thread()
    with claim(folder, "discovery"), Progress(console=Console(stderr=True)) as bar:
        line = bar.add_task("discovering", total=1.0)
        graph = discover_from_samples(
            task, store, origin, settings, about["seed"],
            lambda share, text: bar.update(line, completed=share, description=text), discoverers=plugins.discoverers,
        )  # fmt: skip
        write_graph(folder, graph, manual_graph(task))
    return graph


def _settings(section: Mapping[str, Any], about: Mapping[str, Any], plugins: Plugins) -> DiscoverySettings:
    """Those of `section`, with what determined the samples from `about`."""
    discovery = Sections.of(plugins, []).discovery
    if found := discovery.problem(section):
        raise UserError(f"{'.'.join(map(str, found[0]))}: {found[1]}")
    sampled = ("inference_fraction", "sequence_length", "n_placebos")
    return replace(
        discovery.resolve([section]),
        training_count=about["count"],
        action_repeat=about.get("action_repeat", 1),
        features="features" in about,
        observation=about.get("observation", "state"),
        **{name: about[name] for name in sampled},
    )
