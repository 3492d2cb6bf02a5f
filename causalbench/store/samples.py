"""The samples of a causal discovery as files that numpy reads alone: one .npz a set, in a folder `data`.

`np.load("stage1-random.npz")` gives `states`, `actions`, `rewards` (n rows each), their column names `state_names`,
`action_names`, `reward_names`, `sequence` (n,), and `about`: JSON with units, seed and all that determines the samples;
with `observation: paper` also `frames` (n, size), images as rows of 48 x 64 x 3 or LiDAR scans in metres.
As a table: `pd.DataFrame(d["states"], columns=d["state_names"])`. Nothing in them is ever unpickled.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from causalbench.atomic import write_bytes
from causalbench.core.discovery.samples.streams import About
from causalbench.core.discovery.samples.transitions import Samples
from causalbench.core.staged.worlds import Origin
from causalbench.core.tasks.stage_task import StageTask
from causalbench.errors import RunFolderError

UNITS = {
    "states": "metres; quaternion components (w, x, y, z) have none",
    "actions": "share of full speed, -1 to 1; 0: not executed",
    "rewards": "the task's own",
}
ARRAYS = ("states", "actions", "rewards", "sequence")


@dataclass(frozen=True)
class SampleFolder:
    """A `SampleStore` (core.discovery.samples.collection) in one folder, which is made when first written to."""

    path: Path

    def load(self, about: About) -> Samples | None:
        """See `SampleStore`."""
        try:
            content = _read(self._file(about))
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):  # missing, cut off or not ours
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
            "state_names": np.array(task.input_names),
            "action_names": np.array([*task.actions, *(f"placebo{p}" for p in range(n_placebos))]),
            "reward_names": np.array(task.stage_terms(about["stage"], discoverable_only=True)),
            "about": np.array(
                json.dumps(
                    {"request": about, "units": UNITS, "env_steps": samples.env_steps, "refused": samples.refused}
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

        Raises `RunFolderError` when they are not there.
        """
        path = self.path / "stage1-random.npz"
        try:
            about = _read(path)["about"]["request"]
            return Origin(about["backend"], about["engine"], about["robot"]), about
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise RunFolderError(
                f"{path}: no samples here ({error}); give the folder `data` that `causalbench discover` wrote"
            ) from error

    def _file(self, about: About) -> Path:
        return self.path / f"stage{about['stage']}-{about['set']}.npz"


def _read(path: Path) -> dict[str, Any]:
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
        names = [name for name in (*ARRAYS, "frames") if name in file or name in ARRAYS]
        return {name: file[name] for name in names} | {"about": json.loads(str(file["about"]))}


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
    return buffer.getvalue()
