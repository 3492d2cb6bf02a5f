"""docs/how-to/own_environment.md, followed to the letter, leads from a Gymnasium environment to its causes."""

from __future__ import annotations

import re
from pathlib import Path

from installing import call, install

from causalbench import load_graph

PAGE = Path(__file__).parents[1] / "docs" / "how-to" / "own_environment.md"


def test_the_page_leads_to_a_discovered_graph(tmp_path: Path) -> None:
    (module,), (project,) = (
        re.findall(rf"```{kind}\n(.*?)```", PAGE.read_text(), re.DOTALL) for kind in ("python", "toml")
    )
    folder = tmp_path / "my_pendulum"
    folder.mkdir()
    (folder / "my_pendulum.py").write_text(module)
    (folder / "pyproject.toml").write_text(project)
    install(folder, tmp_path / "site")
    command = next(line for line in PAGE.read_text().splitlines() if line.startswith("causalbench discover"))
    done = call(tmp_path, tmp_path / "site", *command.split(), "--out", "found", "--quiet")
    assert done.returncode == 0, done.stderr
    graph = load_graph(next((tmp_path / "found").glob("discovery/*/graph.json")))
    found = [(stage.actions, stage.terms, stage.matrix.tolist()) for stage in graph.stages]
    causes = [[True, True], [False, False]]  # torque, and never the lamp
    actions = ("torque", "lamp")
    assert found == [(actions, ("r_energy", "r_effort"), causes), (actions, ("r_slower", "r_effort"), causes)]
