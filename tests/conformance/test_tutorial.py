"""docs/tutorial_backend.md: `new-backend` with the code of the page in it, installed as it says, keeps the contract."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from installing import call, install

from causalbench.scaffold import write_backend

PAGE = Path(__file__).parents[2] / "docs" / "tutorial_backend.md"


@pytest.mark.long
def test_the_tutorial_leads_to_a_green_check(tmp_path: Path) -> None:
    folder = write_backend("mujoco_hand", tmp_path)
    package, text = folder / "causalbench_mujoco_hand", PAGE.read_text()
    parts = re.findall(r"^`causalbench_mujoco_hand/scene\.py`:\n\n```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert len(parts) == 5
    (package / "scene.py").write_text("\n".join(parts))
    source = (package / "__init__.py").read_text()
    for name, line in re.findall(r"^((?:ENGINE|MODULES|CAPABILITIES|KNOWN_GAPS)\b).*? = (.*)$", text, re.MULTILINE):
        source, count = re.subn(rf"^({name}.*?) = .*$", lambda m, v=line: f"{m[1]} = {v}", source, flags=re.MULTILINE)
        assert count == 1
    (package / "__init__.py").write_text(source)
    install(folder, tmp_path / "site")
    done = call(tmp_path, tmp_path / "site", "causalbench", "check", "mujoco_hand", "--json")
    checks = json.loads(done.stdout)["checks"]
    others = {check["number"]: check["message"] for check in checks if check["outcome"] != "pass"}
    lacks = {
        "S16": "mobile_base",
        **{f"S{number}": "mobile_base" for number in range(40, 48)},
        "S43": "lidar",
        **{f"S{number}": "rgb" for number in (48, 51, 52)},
        "S54": "a hand without an arm",
    }
    assert others.keys() == lacks.keys()
    assert all(lacks[number] in message for number, message in others.items())
