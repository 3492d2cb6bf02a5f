"""Makes the pages of this folder from the code: `python docs/reference/make.py`."""

from __future__ import annotations

import ast
import dataclasses
import enum
import inspect
import io
import textwrap
import tokenize
import types
import typing
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import annotated_types
import pydantic
import typer

import causalbench
from causalbench import backend, discoverer, learner, method, task, worlds
from causalbench.cli.app import app
from causalbench.core.discovery.discoverers import DISCOVERERS
from causalbench.core.discovery.settings import DiscoverySettings, NoSettings
from causalbench.core.learners.registry import LEARNERS
from causalbench.core.learners.settings import EvaluationSettings
from causalbench.report import columns
from causalbench.store.contents import FILES
from causalbench.suite import schema

MADE = "Made by `python docs/reference/make.py` from the code.\n"
SUITE = (schema.Suite, schema.Tier, schema.TierBackend, schema.PerBackend, schema.PerMethod)
FACADES = (backend, task, learner, method, discoverer, worlds)
BOUNDS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}


def table(header: str, rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table; `header` is its columns between bars."""
    n = header.count("|") + 1
    lines = ["| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in row) + " |" for row in rows]
    return "\n".join([f"| {header} |", "|" + "---|" * n, *lines]) + "\n"


# Settings


def comments(record: type[Any]) -> dict[str, str]:
    """Field -> the comment behind it or on the lines above it, of `record` and what it inherits."""
    found: dict[str, str] = {}
    for kind in reversed(record.__mro__):
        if kind.__module__.startswith("causalbench"):
            found |= _comments_of(inspect.getsource(kind))
    return found


def _comments_of(source: str) -> dict[str, str]:
    words = tokenize.generate_tokens(io.StringIO(source).readline)
    by_line = {word.start[0]: word.string.lstrip("# ") for word in words if word.type == tokenize.COMMENT}
    found = {}
    body = ast.parse(source).body[0]
    assert isinstance(body, ast.ClassDef)
    for node in body.body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            lines = [line for line in range(node.lineno, (node.end_lineno or 0) + 1) if line in by_line]
            above = node.lineno - 1
            while not lines and above in by_line and source.splitlines()[above - 1].lstrip().startswith("#"):
                lines, above = [above], above - 1
            if lines:
                found[node.target.id] = " ".join(by_line[line] for line in lines if line)
    return found


def words_of(hint: Any) -> str:
    """A type for people: `float, > 0, <= 1`."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Annotated:
        bounds = [text for note in inner[1:] for text in _bounds(note)]
        return ", ".join([words_of(inner[0]), *bounds])
    if origin is typing.Literal:
        return " or ".join(f"`{value}`" for value in inner)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(words_of(part) for part in inner)
    if origin is tuple:
        return f"list of {words_of(inner[0])}"
    if origin is dict:
        return f"mapping of {words_of(inner[1])}"
    return {type(None): "null", Any: "any"}.get(hint, getattr(hint, "__name__", str(hint)))


def _bounds(note: Any) -> Iterator[str]:
    if isinstance(note, pydantic.fields.FieldInfo):
        for part in note.metadata:
            yield from _bounds(part)
    if isinstance(note, annotated_types.MinLen):
        yield "not empty"
    for name, sign in BOUNDS.items():
        if getattr(note, name, None) is not None:
            yield f"{sign} {getattr(note, name)}"


def record_rows(record: type[Any], left_out: Iterable[str] = ()) -> Iterator[tuple[str, str, str, str]]:
    """Key, type, default and sentence of each setting of a dataclass."""
    hints, said = typing.get_type_hints(record, include_extras=True), comments(record)
    for field in dataclasses.fields(record):
        if field.name not in left_out:
            default = list(field.default) if isinstance(field.default, tuple) else field.default
            yield f"`{field.name}`", words_of(hints[field.name]), f"`{default}`", said[field.name]


def model_rows(model: type[pydantic.BaseModel]) -> Iterator[tuple[str, str, str, str]]:
    """Key, type, default and sentence of each key of a part of a suite."""
    said = comments(model)
    for name, field in model.model_fields.items():
        default = "required" if field.is_required() else f"`{field.default}`"
        bounds = [text for note in field.metadata for text in _bounds(note)]
        kind = ", ".join([words_of(typing.get_type_hints(model)[name]), *bounds])
        yield f"`{field.alias or name}`", kind, default, said[name]


def settings() -> str:
    """The page of the keys of a suite."""
    head = "key | type | default | "
    parts = ["# Settings\n\n" + MADE + "\n" + _SETTINGS]
    for model in SUITE:
        parts.append(f"\n## {model.__name__}\n\n{inspect.getdoc(model)}\n\n{table(head, model_rows(model))}")
    parts.append(f"\n## evaluation\n\n{table(head, record_rows(EvaluationSettings))}")
    for name, row in LEARNERS.items():
        presets = ", ".join(f"`{preset}`" for preset in row.presets)
        parts.append(
            f"\n## learner: {name}\n\n{row.about}; presets {presets}.\n\n{table(head, record_rows(row.settings))}"
        )
    parts.append(f"\n## discovery\n\n{table(head, record_rows(DiscoverySettings, ['options']))}")
    for name, row in DISCOVERERS.items():
        if row.settings is not NoSettings:
            parts.append(f"\n## discovery: {name}\n\n{row.about}.\n\n{table(head, record_rows(row.settings))}")
    return "".join(parts)


_SETTINGS = """\
This page lists every key of a suite file with its type, default and meaning ([how to write a
suite](../how-to/suite.md)). The first tables are about the file and its parts. Then follow the sections
`evaluation`, `learner` and `discovery`, with one table for each learner and discoverer that comes along. The
settings of a plugin are in its own documentation. In Python the same names are arguments of `EvaluationSettings`,
`SACSettings`, `PPOSettings` and `DiscoverySettings`.
"""

# Command line


def cli() -> str:
    """The page of all commands."""
    parts = ["# Commands\n\n" + MADE + "\n" + _CLI]
    for info in app.registered_commands:
        command = info.callback
        assert command is not None
        name = info.name or command.__name__.replace("_", "-")
        rows = list(parameter_rows(command))
        call = " ".join(["causalbench", name, *(row[0] for row in rows if not row[0].startswith("`"))])
        parts.append(f"\n## causalbench {name}\n\n```text\n{call}\n```\n\n{inspect.getdoc(command)}\n")
        if rows:
            parts.append("\n" + table(" | value | default | ", rows))
    return "".join(parts)


def parameter_rows(command: Callable[..., Any]) -> Iterator[tuple[str, str, str, str]]:
    """How it is written, value, default and sentence of each argument and option."""
    hints = typing.get_type_hints(command, include_extras=True)
    for name, parameter in inspect.signature(command).parameters.items():
        kind, info = typing.get_args(hints[name])
        several = typing.get_origin(kind) is list
        if isinstance(info, typer.models.ArgumentInfo):
            yield name.upper() + "..." * several, _value(kind), "required", info.help or ""
            continue
        default = parameter.default.value if isinstance(parameter.default, enum.Enum) else parameter.default
        written = [text for text in (info.default, *(info.param_decls or ())) if str(text).startswith("--")]
        flag = (written or ["--" + name.replace("_", "-")])[0]
        yield f"`{flag}`", _value(kind), "" if default in (None, False) else f"`{default}`", info.help or ""


def _value(kind: Any) -> str:
    kind = next((part for part in typing.get_args(kind) if part is not type(None)), kind)
    if inspect.isclass(kind) and issubclass(kind, enum.Enum):
        return ", ".join(f"`{choice.value}`" for choice in kind)
    return {Path: "path", str: "text", int: "number", float: "number", bool: ""}.get(kind, "text")


_CLI = """\
This page lists every command with its arguments and options. `causalbench COMMAND --help` prints the same.
`causalbench --version` prints the version. With `CAUSALBENCH_TRACEBACK=1` an error prints its traceback.

| exit code | meaning |
|---|---|
| 0 | The command has done what was asked. |
| 1 | Some cells failed or were skipped, or a check failed. |
| 2 | The command or a file has a mistake, which is named in a sentence. |
| 3 | causalbench or a plugin has a mistake. The message names a file with the traceback. |
| 130 | SIGINT (Ctrl-C) or SIGTERM stopped the command. The same command continues. |
"""

# Python


def api() -> str:
    """The page of all public names."""
    parts = ["# Python\n\n" + MADE + "\n" + _API, "\n## causalbench\n"]
    for name in sorted(causalbench.__all__, key=str.lower):
        thing = getattr(causalbench, name)
        if callable(thing):
            parts.append(f"\n### {name}\n\n```text\n{_signature(name, thing)}\n```\n\n{inspect.getdoc(thing)}\n")
    for facade in FACADES:
        rows = ((f"`{name}`", _summary(getattr(facade, name))) for name in facade.__all__)
        about = (inspect.getdoc(facade) or "").partition("\n\n")[0].replace("\n", " ")
        parts.append(f"\n## {facade.__name__}\n\n{about}\n\n{table('name | ', rows)}")
    return "".join(parts)


def _signature(name: str, thing: Callable[..., Any]) -> str:
    if dataclasses.is_dataclass(thing):
        call = f"{name}({', '.join(field.name + '=...' for field in dataclasses.fields(thing))})"
        return textwrap.fill(call, 120, subsequent_indent=" " * 4)
    given = inspect.signature(thing)
    lines = [f"    {_plain(parameter)},\n" for parameter in given.parameters.values()]
    returned = "" if given.return_annotation in (None, "None") else f" -> {given.return_annotation}"
    return f"{name}(\n{''.join(lines)}){returned}"


def _plain(parameter: inspect.Parameter) -> str:
    """A parameter as written, but a function or record that is the default by its name."""
    default = parameter.default
    text = f"{'**' * (parameter.kind is parameter.VAR_KEYWORD)}{parameter.name}: {parameter.annotation}"
    if default is parameter.empty:
        return text
    if dataclasses.is_dataclass(default):
        return f"{text} = {type(default).__name__}()"
    return f"{text} = {default.__name__.strip('_') if inspect.isfunction(default) else repr(default)}"


def _summary(thing: Any) -> str:
    """The first sentence of what a name stands for, or the value."""
    if inspect.ismodule(thing) or inspect.isclass(thing) or inspect.isroutine(thing) or hasattr(thing, "py_func"):
        return (inspect.getdoc(thing) or "").partition("\n\n")[0].replace("\n", " ")
    if typing.get_origin(thing) is not None:
        return f"`{str(thing).replace('typing.', '')}`"
    if isinstance(thing, frozenset) or (isinstance(thing, dict) and any(map(callable, thing.values()))):
        return f"`{sorted(thing)}`"
    if isinstance(thing, (int, float, str, tuple, dict)):
        return f"`{thing!r}`"
    return {"HookimplMarker": "Marks a function as the implementation of a hook."}[type(thing).__name__]


_API = """\
This page lists the public names: first those of `import causalbench`, which run, train and discover, then one
module for each kind of author (of a backend, a task, a learner, a method, a discoverer), and planted worlds. A
change of them has a line in the change log. Everything else may change without notice.
"""

# Files


def files() -> str:
    """The page of a run folder."""
    return (
        "# Files of a run\n\n"
        + MADE
        + _FILES
        + "\n"
        + table("file | ", ((f"`{f}`", said) for f, said in FILES.items()))
    )


_FILES = """
This page lists the files that `causalbench run` and `causalbench discover` write into the run folder, which is
`runs/<suite>-<tier>/` by default. The columns of each CSV file are in [tables](tables.md). Times are only in
`status.json`, `timing.csv`, `environment.json` and `log.txt`. Every other file of a run that was stopped and
continued has the same bytes as that of an uninterrupted run.
"""

PAGES: dict[str, Callable[[], str]] = {
    "settings": settings,
    "cli": cli,
    "api": api,
    "files": files,
    "tables": columns.page,
}

if __name__ == "__main__":
    for title, page in PAGES.items():
        (Path(__file__).parent / f"{title}.md").write_text(page(), encoding="utf-8")
