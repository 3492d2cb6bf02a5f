"""Free objects beside the target."""

from __future__ import annotations

import dataclasses

import numpy as np

from causalbench.conformance.bench import Bench, expect
from causalbench.conformance.moves import ANGLE_ERROR, POSITION_ERROR, act, aside, refusal, start, steps
from causalbench.core.numerics import rotations
from causalbench.core.world.capabilities import Capability
from causalbench.core.world.facts import Facts
from causalbench.core.world.layout import Layout
from causalbench.errors import CausalbenchError, UnreachableLayoutError

LIFTED = 0.05  # m


def s49_several_objects(bench: Bench) -> None:
    """S49. With `SEVERAL_OBJECTS` a further box rests where the layout puts it and is grasped like the target.

    The hand closes on it and lifts it by 5 cm while the target stays, which is not `holding`; a snapshot keeps it.
    Without the capability `reset` refuses such a layout with an error that is not an `UnreachableLayoutError`:
    no other draw would help. `causalbench.backend.check_layout` does that.
    """
    layout = start(bench.scene, 0, 4)
    two = _with_another(layout, aside(bench.scene, layout))
    if Capability.SEVERAL_OBJECTS not in bench.spec.capabilities:
        _check_refused(bench, two)
        return
    swapped = dataclasses.replace(
        two,
        target=dataclasses.replace(two.target, position=two.others[0].position),
        others=(dataclasses.replace(two.others[0], position=two.target.position),),
    )
    for name, one in (("beside the hand", two), ("in the hand", swapped)):
        reason = refusal(bench.scene, one)
        expect(not reason, f"with a further box {name}, reset refuses a start that it took without it: {reason}")
        _compare(act(bench.scene, 2), one, f"two idle steps after reset, the further box {name}")
    _check_grasp(bench)
    _check_restored(bench)


def _with_another(layout: Layout, other: Layout) -> Layout:
    """`layout` with a box like the target where the target of `other` is."""
    box = dataclasses.replace(other.target, name="other")
    return dataclasses.replace(layout, others=(box,), other_masses=(layout.target_mass,))


def _check_refused(bench: Bench, layout: Layout) -> None:
    try:
        bench.scene.reset(layout)
    except UnreachableLayoutError as error:
        raise AssertionError(
            f"a layout with a further box is refused as if another draw could help: {error}"
        ) from error
    except CausalbenchError:
        return
    raise AssertionError(
        "a layout with a further box was accepted without the capability 'several_objects': call "
        "`causalbench.backend.check_layout` in reset"
    )


def _compare(facts: Facts, layout: Layout, when: str) -> None:
    expect(
        facts.other_positions.shape == (1, 3) and facts.other_quaternions.shape == (1, 4),
        f"facts.other_positions and other_quaternions have the shapes {facts.other_positions.shape} and "
        f"{facts.other_quaternions.shape}, expected (1, 3) and (1, 4)",
    )
    off = float(np.linalg.norm(facts.other_positions[0] - layout.others[0].position))
    expect(off < POSITION_ERROR, f"the further box is {1e3 * off:.2f} mm from where the layout puts it {when}")
    turn = float(rotations.angle_between(facts.other_quaternions[0], layout.others[0].quaternion))
    expect(turn < ANGLE_ERROR, f"the further box is turned by {np.degrees(turn):.2f} degrees {when}")


def _check_grasp(bench: Bench) -> None:
    """The hand, around the further box, closes and lifts."""
    scene = bench.scene
    before = act(scene, steps(scene, 1.5), grip=1.0)
    speed = bench.spec.action_speed[bench.spec.actions.index("armz")]
    after = act(scene, steps(scene, LIFTED / speed) + 1, armz=1.0)
    expect(not (before.holding or after.holding), "`holding` is true of a box that is not the target")
    rise = float(after.other_positions[0, 2] - before.other_positions[0, 2])
    expect(rise > 0.8 * LIFTED, f"a further box that the hand closed on rose by {1e3 * rise:.1f} mm with it, not 50")
    off = float(np.linalg.norm(after.object_position - before.object_position))
    expect(off < POSITION_ERROR, f"the target moved by {1e3 * off:.2f} mm while another box was lifted")


def _check_restored(bench: Bench) -> None:
    """A snapshot of the shared scene as it is now keeps the further box."""
    facts, snapshot = bench.scene.facts(), bench.scene.snapshot()
    fresh = bench.make()
    fresh.restore(snapshot)
    now = fresh.facts()
    expect(now.other_positions.shape == (1, 3), f"{len(now.other_positions)} further boxes after a restore, not 1")
    off = float(np.abs(now.other_positions - facts.other_positions).max())
    allowed = bench.spec.restore_error
    expect(off <= allowed, f"in a restored snapshot the further box is {off:.2g} m off (spec.restore_error: {allowed})")
