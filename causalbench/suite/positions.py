"""YAML with line numbers, so that a mistake can be pointed at."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from causalbench.errors import SuiteError

Location = tuple[int | str, ...]
"""Keys and list indices from the top of the file to a value."""


class PositionedYaml:
    """The data of a YAML file and the line of each key in it. Raises `SuiteError` for what is not YAML."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self.text = path.read_text(encoding="utf-8")
            self._root = yaml.compose(self.text, Loader=yaml.SafeLoader)
            self.data: Any = yaml.safe_load(self.text)
        except (OSError, UnicodeDecodeError) as error:
            raise SuiteError(
                f"{path}: cannot be read ({error}); expected a suite file such as suites/pure_manip.yaml"
            ) from error
        except yaml.MarkedYAMLError as error:
            line = error.problem_mark.line + 1 if error.problem_mark else 1
            raise SuiteError(f"{path}:{line}: not valid YAML: {error.problem}") from error
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
