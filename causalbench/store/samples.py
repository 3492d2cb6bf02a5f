"""The samples of a causal discovery as files that numpy reads alone: one .npz a set, in a folder `data`.

`np.load("stage1-random.npz")` gives `states`, `actions`, `rewards` (n rows each), their column names `state_names`,
`action_names`, `reward_names`, `sequence` (n,), and `about`: JSON with units, seed and all that determines the samples;
with `observation: paper` also `frames` (n, size), images as rows of 48 x 64 x 3 or LiDAR scans in metres.
As a table: `pd.DataFrame(d["states"], columns=d["state_names"])`. Nothing in them is ever unpickled.

A file ends with the SHA-256 of all that comes before it, as the comment of the .zip that an .npz is; it is checked
before anything else is read.
"""

from __future__ import annotations

import hashlib
import io
import json
import logging
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from causalbench import formats
from causalbench.atomic import write_bytes
from causalbench.core.discovery.samples.streams import About
from causalbench.core.discovery.samples.transitions import Samples
from causalbench.core.staged.worlds import Origin
from causalbench.core.tasks.stage_task import StageTask
from causalbench.errors import DamagedFileError
from causalbench.store.files import check_file

UNITS = {
    "states": "metres; quaternion components (w, x, y, z) have none",
    "actions": "share of full speed, -1 to 1; 0: not executed",
    "rewards": "the task's own",
}
ARRAYS = ("states", "actions", "rewards", "sequence")
DIGEST = 64
"""Length of a SHA-256 in hex digits."""

LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class SampleFolder:
    """A `SampleStore` (core.discovery.samples.collection) in one folder, which is made when first written to."""

    path: Path

    def load(self, about: About) -> Samples | None:
        """See `SampleStore`."""
        path = self._file(about)
        if not path.exists():
            return None
        try:
            content = _read(path)
        except DamagedFileError as error:
            LOG.warning("%s; its samples are collected again", error)
            return None
        kept = content.pop("about")
        if kept["request"] != about:
            return None
        frames = content.pop("frames", None)
        seen = {"sensor": kept["sensor"], "frames": (frames,)} if frames is not None else {}
        return Samples(**content, env_steps=kept["env_steps"], refused=kept["refused"], **seen)

    def save(self, about: About, samples: Samples, task: StageTask) -> None:
        """See `SampleStore`."""
        self.path.mkdir(parents=True, exist_ok=True)
        n_placebos = samples.actions.shape[1] - len(task.actions)
        arrays = {name: getattr(samples, name) for name in ARRAYS} | {
            "state_names": np.array(task.input_names("features" in about, about.get("observation") == "sectors")),
            "action_names": np.array([*task.actions, *(f"placebo{p}" for p in range(n_placebos))]),
            "reward_names": np.array(task.stage_terms(about["stage"], discoverable_only=True)),
            "about": np.array(
                json.dumps(
                    {
                        "schema": formats.SAMPLES,
                        "request": about,
                        "units": UNITS,
                        "env_steps": samples.env_steps,
                        "refused": samples.refused,
                    }
                    | ({"sensor": samples.sensor} if samples.sensor else {}),
                    sort_keys=True,
                )
            ),
        }
        if samples.frames:
            arrays["frames"] = np.concatenate(samples.frames)
        write_bytes(self._file(about), _npz(arrays))

    def origin(self) -> tuple[Origin, About]:
        """Which simulator the samples are from, and what determined those of stage 1's D_random.

        Raises `DamagedFileError` when they are not there.
        """
        try:
            about = _read(self.path / "stage1-random.npz")["about"]["request"]
        except DamagedFileError as error:
            raise DamagedFileError(
                f"no samples here: {error}; give the folder `data` that `causalbench discover` wrote"
            ) from error
        return Origin(about["backend"], about["engine"], about["robot"]), about

    def _file(self, about: About) -> Path:
        return self.path / f"stage{about['stage']}-{about['set']}.npz"


def _read(path: Path) -> dict[str, Any]:
    """The arrays of a file and its `about`. Raises `DamagedFileError` unless it is, bit for bit, one that was saved."""
    check_file(path)
    content = path.read_bytes()
    if hashlib.sha256(content[:-DIGEST]).hexdigest().encode() != content[-DIGEST:]:
        raise DamagedFileError(f"{path}: its SHA-256 is not that of the samples that were written")
    try:
        return _unpack(content)
    except Exception as error:  # what was not written by `_npz` may raise anything
        raise DamagedFileError(f"{path}: no samples of schema {formats.SAMPLES} ({error!r})") from error


def _unpack(content: bytes) -> dict[str, Any]:
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        about = json.loads(str(file["about"]))
        if about["schema"] != formats.SAMPLES:
            raise ValueError(f"schema {about['schema']}")
        names = [name for name in (*ARRAYS, "frames") if name in file or name in ARRAYS]
        return {name: file[name] for name in names} | {"about": about}


def _npz(arrays: Mapping[str, np.ndarray[Any, Any]]) -> bytes:
    """The bytes of an .npz; `np.savez` would put the time into them."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, array in arrays.items():
            info = zipfile.ZipInfo(f"{name}.npy")
            if name == "frames":  # of which a tenth is left
                info.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(info, "w") as member:
                np.lib.format.write_array(member, array, allow_pickle=False)  # type: ignore[no-untyped-call]
        archive.comment = bytes(DIGEST)
    content = buffer.getvalue()[:-DIGEST]
    return content + hashlib.sha256(content).hexdigest().encode()
