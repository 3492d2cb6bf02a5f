"""Whether facts go on the same from a snapshot, for the checks of several subjects."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.conformance.bench import Bench, expect
from causalbench.conformance.moves import row, start, walk
from causalbench.core.kit.snapshots import SnapshotCodec
from causalbench.core.world.layout import Layout
from causalbench.core.world.scene import Scene

Array = NDArray[np.float64]


def difference(a: Array, b: Array) -> str:
    """By how much two tables of facts (steps, n) differ, and from which step on."""
    first = int((a != b).any(axis=1).argmax())
    return f"by {np.abs(a - b).max():.2g} at most, first at step {first + 1}"


def replay(scene: Scene) -> Array:
    """Facts now and in 15 steps of gentle actions that leave the gripper alone."""
    return np.vstack([row(scene.facts()), walk(scene, 2, size=0.5, grip=False)])


def _names_and_numbers(bench: Bench, layout: Layout | None) -> bytes:
    expect(layout is not None, "scene.layout is None after a reset and a restore")
    assert layout is not None
    return SnapshotCodec(bench.spec).pack(layout, b"")


def check_restored(bench: Bench, situation: str) -> None:
    """A snapshot of the shared scene as it is now; restored here and into a new scene it must replay the same."""
    scene, allowed = bench.scene, bench.spec.restore_error
    snapshot, layout = scene.snapshot(), scene.layout
    expect(isinstance(snapshot, bytes), f"snapshot() returned {type(snapshot).__name__}, not bytes")
    first = replay(scene)
    start(scene, 9)
    walk(scene, 7, 5)
    for where, target in (("the same scene", scene), ("a new scene", bench.make())):
        target.restore(snapshot)
        expect(
            _names_and_numbers(bench, target.layout) == _names_and_numbers(bench, layout),
            f"{situation}, restored into {where}, scene.layout is another one: restore it from the snapshot",
        )
        again = replay(target)
        off = np.abs(again - first)
        expect(
            off.max() <= allowed,
            f"{situation}, restored into {where}, facts go on otherwise {difference(first, again)} "
            f"(spec.restore_error: {allowed})",
        )
