"""`causalbench new-backend NAME` and `new-task NAME`: plugins that pass `causalbench check`, to go on from.

The files of `templates/` are the plugins, with `$name` and the like to be filled in (`string.Template`).
"""

from __future__ import annotations

import importlib.util
import keyword
import re
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from string import Template

from causalbench.errors import UserError
from causalbench.plugins.manager import installed

SUFFIX = ".template"


def write_backend(name: str, parent: Path) -> Path:
    """Write the plugin of a backend `name` into the new folder `parent`/`name`_backend, and return that folder.

    Raises `UserError` for a name that is none, is taken or whose folder exists, and when the folder cannot be written.
    """
    return _write("backend", name, parent, name in installed().backends)


def write_task(name: str, parent: Path) -> Path:
    """Write the plugin of a task `name` into the new folder `parent`/`name`_task, as `write_backend`."""
    return _write("task", name, parent, name in installed().tasks)


def _write(kind: str, name: str, parent: Path, taken: bool) -> Path:
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name) or keyword.iskeyword(name):
        raise UserError(
            f"{kind} name {name!r}: expected lower-case letters, digits and single underscores, beginning with a "
            f"letter, such as my_{'sim' if kind == 'backend' else kind}"
        )
    package = f"causalbench_{name}"
    if taken or importlib.util.find_spec(package) is not None:
        raise UserError(f"{kind} {name!r} is already installed here; choose another name, or uninstall {package}")
    folder = parent / f"{name}_{kind}"
    if folder.exists():
        raise UserError(f"{folder} already exists; remove it, or choose another --out")
    camel = "".join(part.capitalize() for part in name.split("_"))
    words = {
        "name": name,
        "package": package,
        "distribution": package.replace("_", "-"),
        "camel": camel,
        "scene": f"{camel}Scene",
    }
    try:
        _render(files(__name__) / "templates" / kind, folder, words)
    except OSError as error:
        raise UserError(f"{folder}: cannot be written ({error.strerror}); choose another --out") from error
    return folder


def _render(source: Traversable, target: Path, words: dict[str, str]) -> None:
    """Write the folder `source` to `target`; the subfolder "package" takes the package's name."""
    target.mkdir(parents=True)
    for item in source.iterdir():
        if item.is_dir():
            _render(item, target / (words["package"] if item.name == "package" else item.name), words)
        elif item.name.endswith(SUFFIX):
            text = Template(item.read_text(encoding="utf-8")).substitute(words)
            (target / item.name.removesuffix(SUFFIX)).write_text(text, encoding="utf-8")
