"""What a camera sees."""

from __future__ import annotations

import numpy as np

from causalbench.conformance.bench import Bench, expect
from causalbench.conformance.moves import aside, row, start
from causalbench.core.world.cameras import HEIGHT, WIDTH


def s48_picture(bench: Bench) -> None:
    """S48. A picture is uint8 (height, width, 3) and the caller's own, shows where the box is, and changes nothing.

    The camera "scene", 64 x 48 pixels and another size. Drawn twice in one state it is the same, to the bit; with the
    box at the other side of the table it is another.
    """
    scene = bench.scene
    layout = start(scene, 0)
    before, snapshots = row(scene.facts()), [scene.snapshot(), scene.snapshot()]
    for width, height in ((WIDTH, HEIGHT), (100, 60)):
        picture = scene.render(width, height)
        expect(
            isinstance(picture, np.ndarray) and picture.dtype == np.uint8 and picture.shape == (height, width, 3),
            f"render({width}, {height}) returned {getattr(picture, 'dtype', type(picture))} of shape "
            f"{getattr(picture, 'shape', None)}, expected uint8 ({height}, {width}, 3)",
        )
    first = scene.render(WIDTH, HEIGHT)
    kept = first.copy()
    first[:] = 0
    again = scene.render(WIDTH, HEIGHT)
    expect(np.array_equal(kept, again), "a second picture of one state differs from the first, which was written into")
    after = scene.snapshot()
    expect(np.array_equal(before, row(scene.facts())), "drawing a picture changed the facts")
    if snapshots[0] == snapshots[1]:
        expect(after == snapshots[0], "drawing a picture changed what snapshot() returns")
    scene.reset(aside(scene, layout))
    expect(np.array_equal(kept, again), "a picture changed after it was returned")
    other = scene.render(WIDTH, HEIGHT)
    expect(not np.array_equal(kept, other), 'the camera "scene" shows the same with the box elsewhere on the table')
