"""What facts are."""

from __future__ import annotations

import numpy as np

from causalbench.conformance.bench import Bench, expect
from causalbench.conformance.moves import FIELDS, row, start, vector

SHAPES = {
    "eef_position": (3,), "eef_quaternion": (4,), "gripper_opening": (), "holding": (), "object_position": (3,),
    "object_quaternion": (4,), "base_pose": (3,), "base_velocity": (2,), "collision_base": (), "collision_arm": (),
    "collision_self": (), "other_positions": (0, 3), "other_quaternions": (0, 4),
}  # fmt: skip
FLAGS = ("holding", "collision_base", "collision_arm", "collision_self")
ARRAYS = tuple(name for name in FIELDS if SHAPES[name])


def s06_types(bench: Bench) -> None:
    """S6. Facts are float64 and bool, have the documented shapes and are finite."""
    start(bench.scene, 0)
    facts = bench.scene.facts()
    for name in FIELDS:
        value = np.asarray(getattr(facts, name))
        kind = np.bool_ if name in FLAGS else np.float64
        expect(value.shape == SHAPES[name], f"facts.{name} has shape {value.shape}, expected {SHAPES[name]}")
        expect(value.dtype == kind, f"facts.{name} is {value.dtype}, expected {np.dtype(kind)}")
    for name, extra in facts.extras.items():
        expect(
            np.asarray(extra).dtype == np.float64, f"facts.extras[{name!r}] is {np.asarray(extra).dtype}, not float64"
        )
    expect(np.isfinite(row(facts)).all(), f"facts are not finite: {facts}")


def s07_quaternions(bench: Bench) -> None:
    """S7. Quaternions have unit length and w >= 0."""
    rng = np.random.default_rng(0)
    for seed in range(5):
        start(bench.scene, seed)
        for _ in range(10):
            facts = bench.scene.facts()
            for name in ("eef_quaternion", "object_quaternion"):
                q = getattr(facts, name)
                expect(abs(np.linalg.norm(q) - 1) < 1e-6, f"facts.{name} {q} has length {np.linalg.norm(q):.6f}")
                expect(q[0] >= 0, f"facts.{name} {q} (w, x, y, z) has w < 0; see `rotations.canonical`")
            bench.scene.step(rng.uniform(-1, 1, len(bench.spec.actions)))


def s08_copies(bench: Bench) -> None:
    """S8. Facts belong to the caller: writing into them changes nothing, and later steps do not change them."""
    scene = bench.scene
    start(scene, 0)
    first = scene.facts()
    kept = row(first)
    scene.step(vector(scene, armz=1.0, grip=1.0))
    expect(np.array_equal(row(first), kept), "facts taken before a step changed with it: copy the simulator's arrays")
    now, spoilt = row(scene.facts()), scene.facts()
    arrays = [array for name in ARRAYS if (array := getattr(spoilt, name)).flags.writeable]
    for array in arrays:
        array += 1.0
    unchanged = np.array_equal(row(scene.facts()), now)
    for array in arrays:
        array -= 1.0  # the scene is used further
    expect(unchanged, "writing into facts changed what the next facts say: copy the simulator's arrays")
