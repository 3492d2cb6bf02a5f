"""Names of what is registered: parts of file names and of tables, so they are plain."""

from __future__ import annotations

import re

from causalbench.errors import UserError

PATTERN = "[A-Za-z0-9]([A-Za-z0-9_.-]{0,62}[A-Za-z0-9_])?"
"""What a name of a backend, task, method, learner or discoverer looks like."""


def check_name(kind: str, name: object) -> None:
    """Raise `UserError` unless `name` may be that of a `kind`, such as "backend"."""
    if not isinstance(name, str) or not re.fullmatch(PATTERN, name):
        raise UserError(f"{kind} {name!r}: a name is 1 to 64 letters, digits, '_', '-' and '.', as in my_sim-2.1")
