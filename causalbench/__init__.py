"""causalbench: does knowing which actions cause which rewards make multi-stage robot tasks learnable?

Names are imported on first use, so that `import causalbench` costs next to nothing; it also makes the environments
known to `gymnasium.make`, as does `gymnasium.make("causalbench:causalbench/PureManipulation-v0")` by itself.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from causalbench._version import __version__ as __version__
from causalbench.registration import register_with_gymnasium

if TYPE_CHECKING:
    from causalbench.api import discover as discover
    from causalbench.api import train as train
    from causalbench.core.learners.policy import load_policy as load_policy
    from causalbench.registration import make_env as make_env
    from causalbench.report.frames import load_results as load_results

_HOME = {
    "discover": "causalbench.api",
    "load_policy": "causalbench.core.learners.policy",
    "load_results": "causalbench.report.frames",
    "make_env": "causalbench.registration",
    "train": "causalbench.api",
}


register_with_gymnasium()


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'causalbench' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
