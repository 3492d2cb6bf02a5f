"""Snapshots carry layouts to the bit, in this process and in another."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from causalbench.core.kinematic.spec import MOBILE_SPEC, SPEC
from causalbench.core.kit.snapshots import SnapshotCodec
from causalbench.core.world.layout import Box, Layout
from causalbench.errors import SnapshotError
from causalbench.processes import call_in_new_interpreter

STATE = bytes(range(256))


def box(name: str, rng: np.random.Generator) -> Box:
    return Box(name, rng.random(3), rng.normal(size=3), rng.normal(size=4))


def layout(n_others: int = 2, extras: bool = True) -> Layout:
    rng = np.random.default_rng(n_others)
    values = {
        "friction": 0.1 + 0.2,
        "edge": float(np.nextafter(1.0, 2.0)),
        "none": np.empty(0),
        "grid": rng.random((2, 3)),
    }
    return Layout(
        fixtures=(box("table", rng), box("wall", rng)),
        target=box("Würfel", rng),
        target_mass=1 / 3,
        base_pose=rng.random(3),
        eef_position=rng.random(3),
        eef_quaternion=rng.random(4),
        gripper_opening=0.07,
        others=tuple(box(f"lid {i}", rng) for i in range(n_others)),
        other_masses=tuple(rng.random(n_others).tolist()),
        extras={**values, "point": np.array(0.3)} if extras else {},
    )


def flat(layout: Layout) -> list:
    """Every name, shape and number of a layout."""
    boxes = [*layout.fixtures, layout.target, *layout.others]
    parts = [np.concatenate([b.half_extents, b.position, b.quaternion]).tobytes() for b in boxes]
    extras = [(name, type(v).__name__, np.shape(v), np.asarray(v).tobytes()) for name, v in layout.extras.items()]
    poses = [layout.base_pose, layout.eef_position, layout.eef_quaternion]
    numbers = (layout.target_mass, layout.gripper_opening, *layout.other_masses)
    names = [[b.name for b in layout.fixtures], [b.name for b in layout.others], layout.target.name]
    return [names, parts, [pose.tobytes() for pose in poses], [number.hex() for number in numbers], extras]


@pytest.mark.parametrize("n_others", [0, 1, 3])
@pytest.mark.parametrize("extras", [False, True])
def test_a_layout_comes_back_to_the_bit(n_others, extras):
    given = layout(n_others, extras)
    snapshot = SnapshotCodec(SPEC).pack(given, STATE)
    for codec in (SnapshotCodec(SPEC), SnapshotCodec(dataclasses.replace(SPEC))):
        found, state = codec.unpack(snapshot)
        assert state == STATE
        assert flat(found) == flat(given)
        assert codec.pack(found, STATE) == snapshot


def test_a_codec_does_not_confuse_the_layouts_that_it_remembers():
    codec, given = SnapshotCodec(SPEC), [layout(n) for n in (0, 1, 2)]
    snapshots = [codec.pack(one, bytes([i])) for i, one in enumerate(given)]
    for i in (0, 0, 2, 1, 1, 0):
        found, state = codec.unpack(snapshots[i])
        assert (flat(found), state) == (flat(given[i]), bytes([i]))
        assert codec.pack(given[i], bytes([i])) == snapshots[i]
    assert codec.unpack(snapshots[0])[0] is codec.unpack(snapshots[0])[0]


def _unpacked(snapshot: bytes) -> tuple[list, bytes]:
    found, state = SnapshotCodec(SPEC).unpack(snapshot)
    return flat(found), state


def test_a_snapshot_means_the_same_in_another_process():
    given = layout()
    there = call_in_new_interpreter(_unpacked, SnapshotCodec(SPEC).pack(given, STATE), timeout=120.0)
    assert there == (flat(given), STATE)


@pytest.mark.parametrize(("spoil", "message"), [
    (lambda s: s.replace(b"CBS2", b"CBS1"), "no snapshot of the backend"),
    (lambda s: s[:-1], "is damaged"), (lambda s: s + b"\0", "is damaged"),
    (lambda s: s[:100] + bytes([s[100] ^ 1]) + s[101:], "is damaged"), (lambda s: b"", "no snapshot of the backend"),
])  # fmt: skip
def test_other_bytes_are_refused(spoil, message):
    with pytest.raises(SnapshotError, match=message):
        SnapshotCodec(SPEC).unpack(spoil(SnapshotCodec(SPEC).pack(layout(), STATE)))


def test_a_snapshot_of_another_spec_is_refused():
    with pytest.raises(SnapshotError, match="another spec"):
        SnapshotCodec(MOBILE_SPEC).unpack(SnapshotCodec(SPEC).pack(layout(), STATE))


@pytest.mark.parametrize("masses", [(), (0.1,), (0.1, 0.0), (0.1, 0.2, 0.3)])
def test_every_other_object_has_a_mass(masses):
    with pytest.raises(ValueError, match=r"expected a mass above 0 kg for each of \['lid 0', 'lid 1'\]"):
        dataclasses.replace(layout(2), other_masses=masses)
