"""SHA-256 of data, of files and of arrays: what tells that something is what was written."""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np


def canonical_json(content: Any) -> str:
    """JSON text that equal data share, whatever the order of their keys; a tuple is a list."""
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)


def content_hash(content: Any, digits: int = 10) -> str:
    """The first hex digits of the SHA-256 of canonical JSON."""
    return hashlib.sha256(canonical_json(content).encode()).hexdigest()[:digits]


@functools.cache
def source_hash(package: str) -> str:
    """The first 10 hex digits of the SHA-256 of all Python files of an installed package or module."""
    digest = hashlib.sha256()
    spec = importlib.util.find_spec(package)
    roots = list((spec and spec.submodule_search_locations) or ())
    alone = [Path(spec.origin)] if spec and spec.origin and not roots else []
    for path in sorted([*alone, *(path for root in roots for path in Path(root).rglob("*.py"))]):
        digest.update(f"\n{package} {path.name} {path.stat().st_size}\n".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:10]


def file_digest(path: Path) -> str:
    """SHA-256 of the bytes of a file, hex."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def arrays_digest(values: Any, arrays: Mapping[str, np.ndarray[Any, Any]]) -> str:
    """SHA-256, hex, of JSON data and of named arrays: names, types, shapes and bits; their order does not matter."""
    digest = hashlib.sha256(canonical_json(values).encode())
    for name, array in sorted(arrays.items()):
        digest.update(f"\n{name} {array.dtype.str} {array.shape}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
