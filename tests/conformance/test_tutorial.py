"""docs/tutorial_backend.md: `new-backend` with the code of the page in it, installed as it says, keeps the contract."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

from causalbench.scaffold import write_backend

PAGE = Path(__file__).parents[2] / "docs" / "tutorial_backend.md"


def test_the_tutorial_leads_to_a_green_check(tmp_path: Path) -> None:
    folder = write_backend("mujoco_hand", tmp_path)
    package, text = folder / "causalbench_mujoco_hand", PAGE.read_text()
    parts = re.findall(r"^`causalbench_mujoco_hand/scene\.py`:\n\n```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert len(parts) == 5
    (package / "scene.py").write_text("\n".join(parts))
    source = (package / "__init__.py").read_text()
    for name, line in re.findall(r"^((?:ENGINE|MODULES|CAPABILITIES)\b).*? = (.*)$", text, re.MULTILINE):
        source, count = re.subn(rf"^({name}.*?) = .*$", lambda m, v=line: f"{m[1]} = {v}", source, flags=re.MULTILINE)
        assert count == 1
    (package / "__init__.py").write_text(source)
    options = ["--quiet", "--no-deps", "--no-index", "--no-build-isolation", "--disable-pip-version-check"]
    pip = [sys.executable, "-m", "pip", "install", *options, "--target", str(tmp_path / "site"), str(folder)]
    subprocess.run(pip, check=True, capture_output=True, text=True)
    path = os.pathsep.join(filter(None, [str(tmp_path / "site"), os.environ.get("PYTHONPATH")]))
    command = [sys.executable, "-m", "causalbench", "check", "mujoco_hand", "--json"]
    done = subprocess.run(command, cwd=tmp_path, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True)
    checks = json.loads(done.stdout)["checks"]
    others = {check["number"]: check["message"] for check in checks if check["outcome"] != "pass"}
    assert others.keys() == {"S16", *(f"S{number}" for number in range(40, 48))}  # the lines of a base that drives
    assert all("needs mobile_base" in message for message in others.values())
