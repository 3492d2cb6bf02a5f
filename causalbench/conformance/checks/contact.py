"""What facts say about contact."""

from __future__ import annotations

from itertools import islice

from causalbench.conformance.bench import Bench, expect
from causalbench.conformance.moves import AXES, accepts, act, clear_poses, clear_start, grasp, press, start, steps


def s24_collision(bench: Bench) -> None:
    """S24. `collision_arm` is true while the hand is driven into the table, and false once it has left it."""
    scene = bench.scene
    facts = press(scene)
    expect(
        any(f.collision_arm for f in facts[-3:]),
        "the hand was driven down into the table, but collision_arm is false. Does the hand stop at all? Its height "
        f"in the last steps (m): {[round(float(f.eef_position[2]), 3) for f in facts[-3:]]}",
    )
    low = float(facts[-1].eef_position[2])
    table = scene.spec.workspace.table_height
    expect(low > table - 0.02, f"the hand is {table - low:.3f} m inside the table")
    left = act(scene, steps(scene, 0.7), armz=1.0)
    rise = float(left.eef_position[2]) - low
    expect(rise > 0.05, f"0.7 s of armz off the table raise the hand by {rise:.3f} m only: targets wind up")
    expect(not left.collision_arm, f"collision_arm is still true {rise:.3f} m above the table")


def s25_clear(bench: Bench) -> None:
    """S25. No collision is reported in clear space."""
    scene = bench.scene
    accepted = (layout for layout in clear_poses(scene) if accepts(scene, layout))
    for _ in islice(accepted, 5):
        for name in AXES:
            for value in (0.3, -0.3):
                facts = act(scene, 2, **{name: value})
                flags = {n: bool(getattr(facts, n)) for n in ("collision_base", "collision_arm", "collision_self")}
                expect(not any(flags.values()), f"small motions ({name}) above the table report a collision: {flags}")


def s26_holding(bench: Bench) -> None:
    """S26. `holding` is true for a grasp and false for an open hand around the box and for one closed on nothing."""
    scene = bench.scene
    for seed in range(3):
        start(scene, seed, 4)
        expect(not act(scene, 2).holding, "holding is true while the open hand is around the box")
        grasp(scene, seed)
        act(scene, steps(scene, 2.0), grip=1.0)  # squeezing must wind nothing up
        expect(not act(scene, steps(scene, 1.0), grip=-1.0).holding, "holding is still true after a second of opening")
    clear_start(scene)
    expect(not act(scene, steps(scene, 1.5), grip=1.0).holding, "holding is true for a hand closed on nothing")
