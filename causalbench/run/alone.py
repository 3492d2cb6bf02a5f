"""One causal discovery outside a suite, for `causalbench discover`."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from causalbench.core.discovery.graph import CausalGraph
from causalbench.core.discovery.settings import PRESETS
from causalbench.errors import RunFolderError, UnknownNameError
from causalbench.plugins import installed
from causalbench.run.cell import use_one_thread, write_graph


def discover_alone(task: str, backend: str, preset: str, seed: int, folder: Path) -> CausalGraph:
    """Discover in this process with progress on stderr, write `graph.json` and `kl.csv` into `folder`."""
    if preset not in PRESETS:
        raise UnknownNameError("preset", preset, PRESETS)
    plugins = installed()
    chosen_task, make_scene = plugins.task(task), plugins.backend(backend).make
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunFolderError(f"{folder}: cannot be written ({error.strerror}); choose another with --out") from error
    from causalbench.core.discovery.pipeline import discover

    use_one_thread()
    with Progress(console=Console(stderr=True)) as bar:
        line = bar.add_task("discovering", total=1.0)
        graph = discover(
            chosen_task, make_scene, PRESETS[preset], seed,
            lambda share, text: bar.update(line, completed=share, description=text),
        )  # fmt: skip
        bar.update(line, completed=1.0, description="done")
    write_graph(folder, graph)
    return graph
