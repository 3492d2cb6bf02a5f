"""The same again: determinism, independence, snapshots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causalbench.conformance.bench import Bench, MakeScene, expect, in_new_process
from causalbench.conformance.moves import grasp, press, row, start, walk
from causalbench.conformance.replay import check_restored, difference, replay
from causalbench.core.world.layout import Layout
from causalbench.core.world.scene import Scene
from causalbench.errors import SnapshotError

Array = NDArray[np.float64]

SEEDS = ((0, 1), (1, 3), (2, 4))  # (seed, stage)


def _from_layout(scene: Scene, layout: Layout) -> Array:
    scene.reset(layout)
    return np.vstack([row(scene.facts()), walk(scene, 5, 30)])


def s27_deterministic(bench: Bench) -> None:
    """S27. The same layout and actions give the same facts, to the bit, whatever the scene did before."""
    for seed, stage in SEEDS:
        layout = start(bench.scene, seed, stage)
        first = _from_layout(bench.scene, layout)
        start(bench.scene, 9)
        walk(bench.scene, 6)
        again = _from_layout(bench.scene, layout)
        expect(np.array_equal(first, again), f"the same layout and actions differ {difference(first, again)}")
        fresh = _from_layout(bench.make(), layout)
        expect(np.array_equal(first, fresh), f"a used scene differs from a new one {difference(first, fresh)}")


def s28_new_process(bench: Bench) -> None:
    """S28. The same layout and actions give the same facts, to the bit, in a new process."""
    layouts = [start(bench.scene, seed, stage) for seed, stage in SEEDS]
    here = _all_from_layouts(bench.make_scene, layouts)
    there = in_new_process(_all_from_layouts, bench.make_scene, layouts)
    expect(np.array_equal(here, there), f"a new process differs {difference(here, there)}")


def _all_from_layouts(make_scene: MakeScene, layouts: list[Layout]) -> Array:
    scene = make_scene()
    try:
        return np.vstack([_from_layout(scene, layout) for layout in layouts])
    finally:
        scene.close()


def s29_independent(bench: Bench) -> None:
    """S29. Two live scenes do not touch each other."""
    layout = start(bench.scene, 0)
    alone = _from_layout(bench.make(), layout)
    first, second = bench.make(), bench.make()
    first.reset(layout)
    start(second, 2)
    rng, other = np.random.default_rng(5), np.random.default_rng(7)
    rows = [row(first.facts())]
    for _ in range(30):
        second.step(other.uniform(-1, 1, len(second.spec.actions)))
        first.step(rng.uniform(-1, 1, len(first.spec.actions)))
        rows.append(row(first.facts()))
    together = np.array(rows)
    expect(
        np.array_equal(alone, together),
        f"a scene behaves otherwise when another one is stepped beside it {difference(alone, together)}",
    )


def _free(scene: Scene) -> None:
    start(scene, 3)
    walk(scene, 1, 5)


def s30_snapshot_free(bench: Bench) -> None:
    """S30. A snapshot in free motion, restored in this or another scene, continues in the same way.

    To the bit with the capability `EXACT_RESTORE`, else within `spec.restore_error` in 15 steps.
    `layout` is the snapshot's again.
    """
    _free(bench.scene)
    check_restored(bench, "in free motion")


def s31_snapshot_contact(bench: Bench) -> None:
    """S31. A snapshot that is taken while the hand presses on the table continues in the same way, too."""
    press(bench.scene)
    check_restored(bench, "pressing on the table")


def s32_snapshot_grasp(bench: Bench) -> None:
    """S32. A snapshot that is taken with the box in the hand continues in the same way, too."""
    grasp(bench.scene)
    check_restored(bench, "with the box in the hand")


def s33_snapshot_new_process(bench: Bench) -> None:
    """S33. A snapshot can be restored in a new process and continues in the same way there."""
    snapshots = []
    for prepare in (_free, press, grasp):
        prepare(bench.scene)
        snapshots.append(bench.scene.snapshot())
    here = _all_from_bytes(bench.make_scene, snapshots)
    there = in_new_process(_all_from_bytes, bench.make_scene, snapshots)
    expect(
        np.abs(here - there).max() <= bench.spec.restore_error,
        f"three snapshots restored in a new process go on otherwise than here {difference(here, there)}",
    )


def _all_from_bytes(make_scene: MakeScene, snapshots: list[bytes]) -> Array:
    scene, rows = make_scene(), []
    try:
        for snapshot in snapshots:
            scene.restore(snapshot)
            rows.append(replay(scene))
    finally:
        scene.close()
    return np.vstack(rows)


def s34_foreign_bytes(bench: Bench) -> None:
    """S34. Bytes that are no snapshot of this spec raise `SnapshotError` and change nothing."""
    scene = bench.scene
    start(scene, 0)
    mine, before = scene.snapshot(), row(scene.facts())
    for what, foreign in (
        ("no bytes", b""),
        ("nonsense", b"nonsense"),
        ("a snapshot cut short", mine[:-8]),
        ("a snapshot with eight bytes more", mine + bytes(8)),
        ("zeros of a snapshot's length", bytes(len(mine))),
    ):
        try:
            scene.restore(foreign)
        except SnapshotError:
            continue
        except Exception as error:
            raise AssertionError(f"restoring {what} raised {type(error).__name__}: {error}") from error
        raise AssertionError(f"restoring {what} was accepted: raise SnapshotError")
    expect(np.array_equal(row(scene.facts()), before), "a refused snapshot changed the facts")
