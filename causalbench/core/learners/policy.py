"""A trained staged policy: SB3's `predict`, saved as safetensors plus JSON, loaded without unpickling anything."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.torch import load, save_file
from torch import Tensor

from causalbench import formats
from causalbench.atomic import write_json
from causalbench.core.learners.observations import checked_observation
from causalbench.core.networks.encoder import Encoder
from causalbench.core.networks.gaussian import gaussian_actor
from causalbench.core.networks.squashed_gaussian import squashed_actor, squashed_sample
from causalbench.core.tasks.stage_task import StageTask
from causalbench.digests import content_hash, file_digest
from causalbench.errors import UserError

META, WEIGHTS = "policy.json", "policy.safetensors"

Distribution = Literal["squashed", "gaussian"]
"""What an actor's tensors mean: SAC's squashed Gaussian or PPO's clipped one."""


@dataclass(frozen=True)
class ObservationScale:
    """Makes network inputs of observations: `state` and the gripper's opening are scaled to [-1, 1] by their bounds.

    `low` and `high` are these bounds. `features` are the names of the task's features and `sectors` the number of the
    LiDAR's sectors, which stay as they are. `Encoder` scales `sensor`; "" stands for none.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    sensor: str = ""
    features: tuple[str, ...] = ()
    sectors: int = 0

    @classmethod
    def of(cls, space: Any, task: StageTask, observation: str = "state") -> ObservationScale:
        """From the observation space of a `StageTaskEnv` of `task` and a learner's setting `observation`."""
        parts = [space["state"]] + ([space["gripper"]] if "gripper" in space.spaces else [])
        low, high = (np.concatenate([getattr(part, side) for part in parts]) for side in ("low", "high"))
        features = task.feature_names if "features" in space.spaces else ()
        sectors = space["sectors"].shape[0] if "sectors" in space.spaces else 0
        return cls(tuple(map(float, low)), tuple(map(float, high)), task.sensor_in(observation), features, sectors)

    @property
    def n_inputs(self) -> int:
        """How many numbers the networks take."""
        return len(self.low) + len(self.features) + self.sectors + Encoder(self.sensor).n_sensed

    @cached_property
    def beside(self) -> dict[str, int]:
        """How many numbers each entry of an observation has that is read beside `state` and `gripper`."""
        sizes = {"features": len(self.features), "sectors": self.sectors, self.sensor: Encoder(self.sensor).n_sensed}
        return {name: size for name, size in sizes.items() if size}

    def __call__(self, obs: dict[str, Any]) -> Tensor:
        """(n, n_inputs) float32 network input; `obs` in batches. The networks do not read `stage`."""
        parts = [obs["state"], obs["gripper"]] if len(self.low) > obs["state"].shape[-1] else [obs["state"]]
        low, high = np.array(self.low, dtype=np.float32), np.array(self.high, dtype=np.float32)
        scaled = torch.from_numpy((np.concatenate(parts, axis=-1) - low) * (2 / (high - low)) - 1)
        flat = (torch.from_numpy(obs[name]).reshape(len(scaled), -1).float() for name in self.beside)
        return torch.cat([scaled, *flat], 1)


class StagedPolicy:
    """A policy with one actor per stage. The entry `stage` of an observation says which actor acts."""

    def __init__(
        self,
        actors: Sequence[list[Tensor]],
        actions: Sequence[NDArray[np.int64]],
        n_actions: int,
        scale: ObservationScale,
        distribution: Distribution = "squashed",
        seed: int = 0,
    ) -> None:
        self.actors, self.actions, self.n_actions, self.scale = list(actors), list(actions), n_actions, scale
        self.distribution, self.encoder = distribution, Encoder(scale.sensor)
        self.generator = torch.Generator().manual_seed(seed)

    def predict(
        self,
        observation: dict[str, Any],
        state: tuple[NDArray[Any], ...] | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], tuple[NDArray[Any], ...] | None]:
        """SB3's `predict`: actions for one observation (n_actions,) or a batch (n, n_actions); no recurrent state.

        Raises `InvalidObservationError` for an observation that is not what an environment of the task returns.
        """
        del episode_start  # nothing is remembered between steps
        batched, stages, single = checked_observation(
            observation, self.scale.beside, len(self.scale.low), len(self.actors)
        )
        inputs = self.scale(batched)
        out = np.zeros((len(stages), self.n_actions), dtype=np.float32)
        for index in np.unique(stages):
            rows = np.flatnonzero(stages == index)
            action = self._act(self.actors[index], inputs[rows], deterministic)
            out[np.ix_(rows, self.actions[index])] = action.numpy()
        return (out[0] if single else out), state

    @torch.no_grad()
    def _act(self, actor: list[Tensor], obs: Tensor, deterministic: bool) -> Tensor:
        forward = squashed_actor if self.distribution == "squashed" else gaussian_actor
        mean, log_std = (x.cpu() for x in forward(*self.encoder(actor, obs.to(actor[0].device))))
        noise = torch.zeros_like(mean) if deterministic else torch.randn(mean.shape, generator=self.generator)
        if self.distribution == "squashed":
            return squashed_sample(mean, log_std, noise)[0]
        return (mean + log_std.exp() * noise).clamp(-1.0, 1.0)

    def save(self, folder: Path | str) -> None:
        """Write `policy.safetensors`, and `policy.json` with its SHA-256 and that of all else, into `folder`."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        tensors = {  # clones, since the file has no place for stages that share an actor
            f"stage{i}.{k}": w.detach().cpu().clone(memory_format=torch.contiguous_format)
            for i, actor in enumerate(self.actors, 1)
            for k, w in enumerate(actor)
        }
        save_file(tensors, folder / WEIGHTS)
        meta = {
            "schema": formats.POLICY,
            "distribution": self.distribution,
            "n_actions": self.n_actions,
            "actions": [a.tolist() for a in self.actions],
            "low": self.scale.low,
            "high": self.scale.high,
            "sensor": self.scale.sensor,
            "features": self.scale.features,
            "sectors": self.scale.sectors,
            "weights": file_digest(folder / WEIGHTS),
        }
        write_json(folder / META, meta | {"sha256": content_hash(meta, 64)})


def load_policy(folder: Path | str) -> StagedPolicy:
    """Load the policy that is saved in `folder`, such as the folder `policy` of a cell.

    Raises `UserError` when there is none, when another version wrote it, and when it is not what was saved.
    """
    folder = Path(folder)
    try:
        meta, tensors = _read(folder)
        actors = []
        for stage in range(1, len(meta["actions"]) + 1):
            prefix = f"stage{stage}."
            count = sum(name.startswith(prefix) for name in tensors)
            actors.append([tensors[f"{prefix}{k}"] for k in range(count)])
        actions = [np.array(a, dtype=np.int64) for a in meta["actions"]]
        bounds = tuple(meta["low"]), tuple(meta["high"])
        scale = ObservationScale(*bounds, meta["sensor"], tuple(meta["features"]), meta["sectors"])
        return StagedPolicy(actors, actions, meta["n_actions"], scale, meta["distribution"])
    except FileNotFoundError as error:
        raise UserError(f"{folder}: no trained policy here ({error.filename} is missing)") from error
    except (OSError, SafetensorError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{folder}: not a policy that causalbench saved, or damaged ({error}); train again") from error


def _read(folder: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """What is written in the two files. Raises `ValueError` unless it is what was saved, by this version."""
    meta = json.loads((folder / META).read_bytes())
    content = (folder / WEIGHTS).read_bytes()
    if meta["schema"] != formats.POLICY:
        raise ValueError(f"schema {meta['schema']}, expected {formats.POLICY}")
    if meta.pop("sha256") != content_hash(meta, 64):
        raise ValueError(f"the SHA-256 of {META} differs")
    if meta["weights"] != hashlib.sha256(content).hexdigest():
        raise ValueError(f"the SHA-256 of {WEIGHTS} differs")
    return meta, load(content)
