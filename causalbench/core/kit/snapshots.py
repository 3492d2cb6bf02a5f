"""The bytes of a snapshot: a header that names the backend and the scene's spec, the layout and the simulator state."""

from __future__ import annotations

import hashlib
import json
import math
import struct
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causalbench import formats
from causalbench.core.world.layout import Box, Layout
from causalbench.core.world.scene import SceneSpec
from causalbench.errors import SnapshotError

Array = NDArray[np.float64]

MAGIC = f"CBS{formats.SNAPSHOT}".encode()
# Magic, digest of the spec, of all that follows, bytes of the backend's name, of the layout's names and of the state.
_HEAD = struct.Struct("<4s32s32sIII")
_BOX = 10  # half extents, position, quaternion
_POSE = 12  # mass of the target, base pose, hand position and quaternion, opening


def spec_digest(spec: SceneSpec) -> bytes:
    """32 bytes that two specs share if and only if they are equal, in any process."""
    fields = asdict(spec)
    fields["capabilities"] = sorted(spec.capabilities)
    return hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).digest()


class SnapshotCodec:
    """Packs and unpacks the snapshots of scenes of one spec.

    Whoever compares actions returns to one start again and again, so the codec remembers the last layout and its bytes
    and gives the same object for the same bytes: layouts are read, never written into.
    """

    def __init__(self, spec: SceneSpec) -> None:
        self._backend, self._spec = spec.backend, spec_digest(spec)
        self._layout: Layout | None = None
        self._packed = (b"", b"")  # the last layout's names and numbers

    def pack(self, layout: Layout, state: bytes) -> bytes:
        """Bytes of a layout, to the bit, and the simulator's own `state`."""
        if layout is not self._layout:
            self._packed = json.dumps(_names(layout)).encode(), _numbers(layout).astype("<f8").tobytes()
            self._layout = layout
        backend, (names, numbers) = self._backend.encode(), self._packed
        body = b"".join((backend, names, numbers, state))
        check = hashlib.sha256(body).digest()
        return _HEAD.pack(MAGIC, self._spec, check, len(backend), len(names), len(state)) + body

    def unpack(self, snapshot: bytes) -> tuple[Layout, bytes]:
        """Layout and state of `pack`.

        Raises `SnapshotError` for bytes that a scene of another spec or nobody made, or that are damaged.
        """
        if len(snapshot) < _HEAD.size or snapshot[:4] != MAGIC:
            raise SnapshotError(f"these bytes are no snapshot of the backend {self._backend!r}")
        _, spec, check, n_backend, n_names, n_state = _HEAD.unpack_from(snapshot)
        body = snapshot[_HEAD.size :]
        if hashlib.sha256(body).digest() != check:
            raise SnapshotError(f"this snapshot is damaged: its {len(body)} bytes are not those that were packed")
        backend = body[:n_backend].decode()
        if backend != self._backend:
            raise SnapshotError(f"this snapshot is of the backend {backend!r}, not of {self._backend!r}")
        if spec != self._spec:
            raise SnapshotError(
                "this snapshot is from a scene of another spec: restore it with the same versions and options"
            )
        begin, end = n_backend + n_names, len(body) - n_state
        return self._layout_of(body[n_backend:begin], body[begin:end]), body[end:]

    def _layout_of(self, names: bytes, numbers: bytes) -> Layout:
        if self._layout is None or self._packed != (names, numbers):
            self._layout = _layout(json.loads(names), np.frombuffer(numbers, "<f8").astype(np.float64))
            self._packed = names, numbers
        return self._layout


def _names(layout: Layout) -> dict[str, Any]:
    """What says what the numbers of a layout are; the shape of an extra that is a plain number is null."""
    extras = {
        name: None if isinstance(value, float | int) else np.shape(value) for name, value in layout.extras.items()
    }
    return {
        "fixtures": [box.name for box in layout.fixtures],
        "target": layout.target.name,
        "others": [box.name for box in layout.others],
        "extras": extras,
    }


def _numbers(layout: Layout) -> Array:
    boxes = (*layout.fixtures, layout.target, *layout.others)
    parts = [part for box in boxes for part in (box.half_extents, box.position, box.quaternion)]
    parts += [np.array([layout.target_mass]), layout.base_pose, layout.eef_position, layout.eef_quaternion]
    parts += [np.array([layout.gripper_opening, *layout.other_masses])]
    return np.concatenate([*parts, *(np.ravel(value) for value in layout.extras.values())])


def _layout(names: Mapping[str, Any], numbers: Array) -> Layout:
    """The layout of `_names` and `_numbers`. Raises `SnapshotError` for too many or too few numbers."""
    labels = [*names["fixtures"], names["target"], *names["others"]]
    n_fixtures, n_others = len(names["fixtures"]), len(names["others"])
    sizes = {name: math.prod(shape or ()) for name, shape in names["extras"].items()}
    if len(numbers) != _BOX * len(labels) + _POSE + n_others + sum(sizes.values()):
        raise SnapshotError(f"this snapshot is damaged: {len(numbers)} numbers for {len(labels)} boxes")
    rows, rest = numbers[: _BOX * len(labels)].reshape(-1, _BOX), numbers[_BOX * len(labels) :]
    boxes = tuple(Box(label, row[:3], row[3:6], row[6:]) for label, row in zip(labels, rows, strict=True))
    pose, masses, left = rest[:_POSE], rest[_POSE : _POSE + n_others], rest[_POSE + n_others :]
    extras: dict[str, float | Array] = {}
    for name, shape in names["extras"].items():
        part, left = left[: sizes[name]], left[sizes[name] :]
        extras[name] = float(part[0]) if shape is None else part.reshape(shape)
    return Layout(
        fixtures=boxes[:n_fixtures],
        target=boxes[n_fixtures],
        target_mass=float(pose[0]),
        base_pose=pose[1:4],
        eef_position=pose[4:7],
        eef_quaternion=pose[7:11],
        gripper_opening=float(pose[11]),
        others=boxes[n_fixtures + 1 :],
        other_masses=tuple(masses.tolist()),
        extras=extras,
    )
