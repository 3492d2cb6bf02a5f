"""The generated robot, from the user's cache directory or made anew. Imports MuJoCo only when it has to be made."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import shutil
import tempfile
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path

import numpy as np

import causalbench_mujoco
from causalbench.backend import arm_ik, fetch
from causalbench_mujoco.fetch_assets import fetch_assets

_KIT = Path(causalbench_mujoco.__file__).parent
_GENERATOR = (Path(__file__).with_name("urdf.py"), Path(fetch.__file__), _KIT / "fetch_model.py", _KIT / "arms.py")


@dataclass(frozen=True)
class Robot:
    """Fetch as a URDF, with its arm's kinematics in the base frame."""

    urdf: Path
    chain: arm_ik.Chain
    hand_position: tuple[float, ...]  # m, of the end effector in the last link
    hand_quaternion: tuple[float, ...]  # (x, y, z, w), Bullet's order
    gap: float  # m between closed finger pads
    base_links: tuple[str, ...]  # fixed to the base link
    passing: tuple[tuple[str, str], ...]  # pairs of links that never collide


def cache_folder() -> Path:
    """Where generated files are kept: `$XDG_CACHE_HOME/causalbench`, or `~/.cache/causalbench`."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "causalbench"


@cache
def load() -> Robot:
    """The robot; the first use on a machine takes seconds."""
    final = cache_folder() / f"fetch-urdf-{_content_hash(fetch_assets())}"
    if not (final / "fetch.json").exists():
        try:
            _make(final)
        except OSError as error:
            folder = tempfile.TemporaryDirectory(prefix="causalbench-")
            _KEPT.append(folder)
            final = Path(folder.name) / "robot"
            _make(final)
            logging.getLogger(__name__).warning(
                "the robot is generated anew in every process, for the cache cannot be written (XDG_CACHE_HOME): %s",
                error,
            )
    facts = json.loads((final / "fetch.json").read_text())
    limits = [limit or (-np.inf, np.inf) for limit in facts["limits"]]
    parts = (facts["rotations"], facts["offsets"], facts["axes"], limits)
    return Robot(
        urdf=final / "fetch.urdf",
        chain=arm_ik.Chain(*(np.array(part, dtype=np.float64) for part in parts)),
        hand_position=tuple(facts["hand_position"]),
        hand_quaternion=tuple(facts["hand_quaternion"]),
        gap=facts["gap"],
        base_links=tuple(facts["base_links"]),
        passing=tuple((first, second) for first, second in facts["passing"]),
    )


_KEPT: list[tempfile.TemporaryDirectory[str]] = []  # deleted when the process ends


def _content_hash(source: Path) -> str:
    """Of everything that the generated files depend on."""
    digest = hashlib.sha256(f"mujoco {metadata.version('mujoco')}".encode())
    files = [path for part in ("fetch", "stls/fetch") for path in sorted((source / part).iterdir()) if path.is_file()]
    for path in (*_GENERATOR, *files):
        digest.update(path.name.encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:24]


def _make(final: Path) -> None:
    """Generate into a folder beside `final` and rename that, so that `final` is never half written."""
    from causalbench_pybullet import urdf

    final.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".making-", dir=final.parent) as scratch:
        made = Path(scratch) / "robot"
        made.mkdir()
        urdf.write(made)
        try:
            made.rename(final)
        except OSError:  # another process was faster
            if not (final / "fetch.json").exists():
                shutil.rmtree(final, ignore_errors=True)
                made.rename(final)
