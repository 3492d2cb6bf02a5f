"""The bytes of a snapshot: a header that names the scene's spec, the layout and the simulator state."""

from __future__ import annotations

import hashlib
import json
import struct
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from causalbench.core.layout import Box, Layout
from causalbench.core.scene import SceneSpec
from causalbench.errors import SnapshotError

Array = NDArray[np.float64]

MAGIC = b"CBGR"
_HEAD = struct.Struct("<4s32sII")  # magic, digest of the spec, bytes of the names, number of doubles
_BOX = 10  # half extents, position, quaternion
_LAYOUT = 12  # mass, base pose, hand position and quaternion, opening


def spec_digest(spec: SceneSpec) -> bytes:
    """32 bytes that two specs share if and only if they are equal, in any process."""
    fields = asdict(spec)
    fields["capabilities"] = sorted(spec.capabilities)
    return hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).digest()


def pack(digest: bytes, layout: Layout, state: Array) -> bytes:
    """Bytes of a layout and a simulator state (n,)."""
    boxes = (*layout.fixtures, layout.target)
    names = json.dumps([box.name for box in boxes]).encode()
    parts = [part for box in boxes for part in (box.half_extents, box.position, box.quaternion)]
    parts += [np.array([layout.target_mass]), layout.base_pose, layout.eef_position, layout.eef_quaternion]
    numbers = np.concatenate([*parts, np.array([layout.gripper_opening]), state])
    head: bytes = _HEAD.pack(MAGIC, digest, len(names), len(numbers))
    tail: bytes = numbers.astype("<f8").tobytes()
    return head + names + tail


def unpack(digest: bytes, snapshot: bytes, n_state: int) -> tuple[Layout, Array]:
    """Layout and state of `pack`. Raises `SnapshotError` for bytes that a scene of another spec or nobody made."""
    if len(snapshot) < _HEAD.size or snapshot[:4] != MAGIC:
        raise SnapshotError("these bytes are no snapshot of the backend 'gymrob'")
    _, theirs, n_names, n_numbers = _HEAD.unpack_from(snapshot)
    if theirs != digest:
        raise SnapshotError(
            "this snapshot is from a scene of another spec: restore it with the same versions, control_hz and timestep"
        )
    if len(snapshot) != _HEAD.size + n_names + 8 * n_numbers:
        raise SnapshotError(f"this snapshot is damaged: {len(snapshot)} bytes do not fit its header")
    names = json.loads(snapshot[_HEAD.size : _HEAD.size + n_names])
    numbers = np.frombuffer(snapshot, "<f8", offset=_HEAD.size + n_names).astype(np.float64)
    if len(numbers) != _BOX * len(names) + _LAYOUT + n_state:
        raise SnapshotError(f"this snapshot is damaged: {len(numbers)} numbers for {len(names)} boxes")
    rows = numbers[: _BOX * len(names)].reshape(-1, _BOX)
    boxes = [Box(name, row[:3], row[3:6], row[6:]) for name, row in zip(names, rows, strict=True)]
    rest = numbers[_BOX * len(names) :]
    layout = Layout(tuple(boxes[:-1]), boxes[-1], float(rest[0]), rest[1:4], rest[4:7], rest[7:11], float(rest[11]))
    return layout, rest[_LAYOUT:]
