"""`causalbench.load_graph`: a graph as it was written, or an error of our own."""

from __future__ import annotations

from pathlib import Path

import pytest

import causalbench
from causalbench.core.discovery.graph import manual_graph
from causalbench.core.tasks.pure_manipulation import TASK
from causalbench.errors import InvalidGraphError


@pytest.mark.parametrize("kind", [str, Path])
def test_a_graph_comes_back(kind: type, tmp_path: Path) -> None:
    graph = manual_graph(TASK)
    (tmp_path / "graph.json").write_text(graph.to_json())
    assert causalbench.load_graph(kind(tmp_path / "graph.json")).hash == graph.hash


@pytest.mark.parametrize("content", [None, "", "{}", "[1"])
def test_what_is_no_graph_is_refused(content: str | None, tmp_path: Path) -> None:
    path = tmp_path / "graph.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InvalidGraphError):
        causalbench.load_graph(path)
