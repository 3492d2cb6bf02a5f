"""The reference backend keeps the contract, and so does every installed backend whose own tests are not in plugins/."""

from __future__ import annotations

from pathlib import Path

import backend_option

from causalbench.conformance.testing import SceneConformance

PLUGINS = Path(__file__).parents[2] / "plugins"

for _name in backend_option.names():
    if not (PLUGINS / f"{_name}_backend").is_dir():
        _class = f"TestConformance_{_name}"
        globals()[_class] = type(_class, (SceneConformance,), {"backend": _name})
