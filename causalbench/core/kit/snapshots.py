"""The bytes of a snapshot: a header that names the backend and the scene's spec, the layout and the simulator state."""

from __future__ import annotations

import hashlib
import json
import struct
from dataclasses import asdict

import numpy as np

from causalbench import formats
from causalbench.core.world.layout import Box, Layout
from causalbench.core.world.scene import SceneSpec
from causalbench.errors import SnapshotError

MAGIC = f"CBS{formats.SNAPSHOT}".encode()
# Magic, digest of the spec, of all that follows, bytes of the backend's name, of the boxes' names and of the state.
_HEAD = struct.Struct("<4s32s32sIII")
_BOX = 10  # half extents, position, quaternion
_LAYOUT = 12  # mass, base pose, hand position and quaternion, opening


def spec_digest(spec: SceneSpec) -> bytes:
    """32 bytes that two specs share if and only if they are equal, in any process."""
    fields = asdict(spec)
    fields["capabilities"] = sorted(spec.capabilities)
    return hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).digest()


class SnapshotCodec:
    """Packs and unpacks the snapshots of scenes of one spec."""

    def __init__(self, spec: SceneSpec) -> None:
        self._backend, self._spec = spec.backend, spec_digest(spec)

    def pack(self, layout: Layout, state: bytes) -> bytes:
        """Bytes of a layout and the simulator's own `state`."""
        boxes = (*layout.fixtures, layout.target)
        parts = [part for box in boxes for part in (box.half_extents, box.position, box.quaternion)]
        parts += [np.array([layout.target_mass]), layout.base_pose, layout.eef_position, layout.eef_quaternion]
        numbers: bytes = np.concatenate([*parts, np.array([layout.gripper_opening])]).astype("<f8").tobytes()
        backend, names = self._backend.encode(), json.dumps([box.name for box in boxes]).encode()
        body = backend + names + numbers + state
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
        names = json.loads(body[n_backend : n_backend + n_names])
        end = len(body) - n_state
        numbers = np.frombuffer(body[n_backend + n_names : end], "<f8").astype(np.float64)
        rows = numbers[: _BOX * len(names)].reshape(-1, _BOX)
        boxes = [Box(name, row[:3], row[3:6], row[6:]) for name, row in zip(names, rows, strict=True)]
        rest = numbers[_BOX * len(names) :]
        if len(rest) != _LAYOUT:
            raise SnapshotError(f"this snapshot is damaged: {len(numbers)} numbers for {len(names)} boxes")
        layout = Layout(tuple(boxes[:-1]), boxes[-1], float(rest[0]), rest[1:4], rest[4:7], rest[7:11], float(rest[11]))
        return layout, body[end:]
