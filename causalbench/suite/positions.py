"""YAML with line numbers, so that a mistake can be pointed at; a small and safe part of the language.

Values are those of JSON, written as people write them (`1_000`, `1e-3`); no aliases, tags, merge keys or dates.
"""

from __future__ import annotations

import re
import stat
from pathlib import Path
from typing import Any, Protocol

import yaml

from causalbench.errors import SuiteError

Location = tuple[int | str, ...]
"""Keys and list indices from the top of the file to a value."""

MAX_BYTES = 1_000_000
MAX_DEPTH = 20  # of values within values; a suite needs 6, and PyYAML takes half a minute to give up on 5,000


class Source(Protocol):
    """Where the data of a suite come from, and how to point at a place in it."""

    @property
    def data(self) -> Any:
        """The content, as YAML's data."""

    @property
    def text(self) -> str:
        """The suite as a file has it."""

    def mistake(self, location: Location, message: str) -> SuiteError:
        """The error for the value at `location`."""


class _Loader(yaml.SafeLoader):
    """Reads no aliases (a few lines of them can stand for billions of values), no tags and nothing nested deeply."""

    depth = 0
    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012 - PyYAML's name, and its type

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Refuse what is not plain data. Raises `ComposerError` with its position."""
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        refused = "aliases are not read, write the value" if isinstance(event, yaml.AliasEvent) else ""
        if getattr(event, "tag", None):
            refused = "tags are not read, leave it out"
        if self.depth > MAX_DEPTH:
            refused = "nested too deeply for a suite"
        if refused:
            raise yaml.composer.ComposerError(None, None, refused, event.start_mark)
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


for _tag, _pattern, _first in (
    ("null", r"~|null|", ["~", "n", ""]),
    ("bool", r"true|false", ["t", "f"]),
    ("int", r"[-+]?(0|[1-9][0-9_]*)", list("-+0123456789")),
    ("float", r"[-+]?((0|[1-9][0-9_]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?", list("-+.0123456789")),
):
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(f"^(?:{_pattern})$"), _first)


class PositionedYaml:
    """The data of a YAML file and the line of each key in it. Raises `SuiteError` for what is not such a file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.text = _read(path)
        try:
            loader = _Loader(self.text)
            self._root = loader.get_single_node()
            self.data: Any = None if self._root is None else loader.construct_document(self._root)
        except yaml.MarkedYAMLError as error:
            line = error.problem_mark.line + 1 if error.problem_mark else 1
            raise SuiteError(f"{path}:{line}: not valid YAML: {error.problem}") from error
        except yaml.YAMLError as error:
            raise SuiteError(f"{path}: not valid YAML: {error}") from error
        except ValueError as error:
            raise SuiteError(f"{path}: a whole number in it has thousands of digits") from error
        self._refuse_duplicates(self._root, ())

    def mistake(self, location: Location, message: str) -> SuiteError:
        """The error "file:line: key: message" for the value at `location`."""
        key = ".".join(str(part) for part in location) or "the file"
        return SuiteError(f"{self.path}:{self.line(location)}: {key}: {message}")

    def line(self, location: Location) -> int:
        """Line (from 1) of the key at `location`, or of the nearest enclosing one that exists."""
        node, line = self._root, 1
        for part in location:
            if isinstance(node, yaml.MappingNode):
                found = [(key, value) for key, value in node.value if key.value == str(part)]
                if not found:
                    break
                line, node = found[0][0].start_mark.line + 1, found[0][1]
            elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
                node = node.value[part]
                line = node.start_mark.line + 1
            else:
                break
        return line

    def _refuse_duplicates(self, node: yaml.Node | None, location: Location) -> None:
        """YAML keeps the last of two equal keys without a word."""
        if isinstance(node, yaml.MappingNode):
            seen: set[str] = set()
            for key, value in node.value:
                if key.value in seen:
                    raise SuiteError(f"{self.path}:{key.start_mark.line + 1}: {key.value}: this key is given twice")
                seen.add(key.value)
                self._refuse_duplicates(value, (*location, key.value))
        elif isinstance(node, yaml.SequenceNode):
            for index, value in enumerate(node.value):
                self._refuse_duplicates(value, (*location, index))


def _read(path: Path) -> str:
    """The text of a regular file of moderate size. Raises `SuiteError`."""
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            raise SuiteError(f"{path}: not a regular file; expected a suite file, or a name such as pure_manip")
        if found.st_size > MAX_BYTES:
            raise SuiteError(f"{path}: {found.st_size} bytes, and a suite file has at most {MAX_BYTES}")
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SuiteError(
            f"{path}: cannot be read ({error}); expected a suite file, or a name such as pure_manip"
        ) from error
