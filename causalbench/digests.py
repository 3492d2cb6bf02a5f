"""SHA-256 of data, of files and of arrays: what tells that something is what was written."""

from __future__ import annotations

import hashlib
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
