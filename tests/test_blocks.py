"""Every block of code in the documentation: Python runs, a suite is valid, a command parses; what cannot is listed."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
import types
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
import typer
import yaml
from test_docs import PAGES, ROOT

from causalbench.cli.app import app
from causalbench.plugins.manager import installed
from causalbench.suite.schema import Suite, load_suite

TEMPLATES = sorted((ROOT / "causalbench" / "scaffold").rglob("README.md.template"))
LANGUAGES = {"python", "yaml", "toml", "sh", "text"}
"""`text` is a drawing, a list of files or a signature."""

PIECES = {
    "docs/tutorial_backend.md": (
        "parts of modules: tests/conformance/test_tutorial.py puts those before 'With an arm' together and checks "
        "them, the others are lines of the example, and a scan, which takes a minute",
        "examples/hinge_arm_backend/causalbench_hinge_arm",
    ),
}
"""Pages whose Python cannot run as it stands: why, and the folder that has it, line for line."""

PROGRAMS = {"docs/how-to/other_libraries.md"}
"""Pages whose blocks start processes, which import the file that they are in: each is run as a file."""


class Block(NamedTuple):
    page: str
    number: int
    language: str
    code: str

    def __str__(self) -> str:
        return f"{self.page}-{self.number}"


def blocks(language: str = "") -> list[Block]:
    return [block for page in [*PAGES, *TEMPLATES] for block in _of(page) if language in ("", block.language)]


def _of(page: Path) -> Iterator[Block]:
    found = re.findall(r"^( *)```(\w*)\n(.*?)^\1```", page.read_text(), re.MULTILINE | re.DOTALL)
    for number, (indent, language, code) in enumerate(found):
        plain = "".join(line.removeprefix(indent) for line in code.splitlines(keepends=True))
        yield Block(str(page.relative_to(ROOT)), number, language, plain)


def python(pieces: bool) -> list[Block]:
    return [block for block in blocks("python") if (block.page in PIECES) is pieces and block.page not in PROGRAMS]


def test_every_block_says_what_it_is_and_no_text_hides_code() -> None:
    assert {block.language for block in blocks()} == LANGUAGES
    hidden = re.compile(r"^(causalbench \w+ .*--|pip install|import |from .* import|schema: )", re.MULTILINE)
    assert [str(block) for block in blocks("text") if hidden.search(block.code)] == []
    assert PIECES.keys() | PROGRAMS <= {block.page for block in blocks("python")}


# Python


@pytest.fixture
def beside_a_run(finished_run: Path, tiny_suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A working directory with `suite.yaml`, the pages' `runs/pure_manip-quick` and a folder `data` of samples."""
    shutil.copy(tiny_suite, tmp_path / "suite.yaml")
    shutil.copytree(finished_run, tmp_path / "runs" / "pure_manip-quick")
    shutil.copytree(next(finished_run.glob("discovery/*/data")), tmp_path / "data")
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("block", python(pieces=False), ids=str)
@pytest.mark.usefixtures("beside_a_run")
def test_python_runs_as_it_stands(block: Block, monkeypatch: pytest.MonkeyPatch) -> None:
    module = types.ModuleType("documentation")
    monkeypatch.setitem(sys.modules, module.__name__, module)  # where dataclasses look up their types
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        exec(compile(block.code, str(block), "exec"), vars(module))  # a page of this repository


@pytest.mark.parametrize("block", [block for block in blocks("python") if block.page in PROGRAMS], ids=str)
def test_a_program_runs_as_a_file(block: Block, tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(block.code)
    env = os.environ | {"PYTHONWARNINGS": "default"}
    done = subprocess.run([sys.executable, "program.py"], cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout


@pytest.mark.parametrize("block", python(pieces=True), ids=str)
def test_a_piece_is_in_the_module_that_it_is_from(block: Block) -> None:
    compile(block.code if block.code[0] != " " else f"def part():\n{block.code}", str(block), "exec")
    tested, *_ = (ROOT / block.page).read_text().partition("## With an arm")
    if block.code in tested or "reach_scan.scan(" in block.code:
        return
    sources = [path.read_text() for path in (ROOT / PIECES[block.page][1]).glob("*.py")]
    lines = [line.strip() for line in block.code.splitlines() if line.strip()]
    assert any(all(line in source for line in lines) for source in sources)


# Suites

METHODS = "[cmSAC, cmmSAC, mSAC, cSAC, cmPPO, mPPO, cmSAC-scalar]"
REST = f"""\
schema: 1
name: block
task: pure_manipulation
backends: [kinematic]
methods: {METHODS}
tiers: {{quick: {{seeds: 1, env_steps: 100}}}}
"""


@pytest.mark.parametrize("block", blocks("yaml"), ids=str)
def test_a_suite_or_a_part_of_one_is_valid(block: Block, tmp_path: Path) -> None:
    given = yaml.safe_load(block.code)
    assert given.keys() <= {field.alias or name for name, field in Suite.model_fields.items()}
    path = tmp_path / "suite.yaml"
    rest = [line for line in REST.splitlines(keepends=True) if line.partition(":")[0] not in given]
    path.write_text("".join(rest if "schema" not in given else []) + block.code)
    load_suite(path, installed())


@pytest.mark.parametrize("block", blocks("toml"), ids=str)
def test_toml_is_valid(block: Block) -> None:
    assert tomllib.loads(block.code)


# Commands


def lines() -> list[tuple[str, str]]:
    found = [(str(block), line) for block in blocks("sh") for line in re.split(r"\n|&&", block.code)]
    return [(block, line.strip()) for block, line in found if line.strip() and not line.startswith("#")]


@pytest.mark.parametrize(("block", "line"), lines())
def test_a_command_parses_and_what_it_names_is_there(block: str, line: str) -> None:
    command, *arguments = shlex.split(line, comments=True)
    if command == "causalbench":
        group = typer.main.get_command(app)
        group.commands[arguments[0]].make_context(arguments[0], arguments[1:])  # type: ignore[attr-defined]
    elif command == "make":
        assert re.search(rf"^{arguments[0]}:", (ROOT / "Makefile").read_text(), re.MULTILINE)
    else:
        assert command in ("cd", "pip", "python", "pytest") or (ROOT / command).is_file()
    made_here = {"suite.yaml", "my_suite.yaml", "my_sim_backend", "mujoco_hand_backend", "my_task_task"}
    for name in arguments:
        if ("/" in name or name.endswith((".py", ".yaml"))) and not re.match(r"(/|runs/|.*=|https?:)", name):
            assert name in made_here or (ROOT / name).exists(), name
