"""Furnished living rooms as engine-neutral boxes, and the ground on which a robot can stand and turn in them.

World frame: the origin is the middle of the floor. Every plan has the same fixtures at other places, so that a
simulator moves boxes from reset to reset and never builds a new world. Parts of scipy are imported where a map is made:
commands that need none start sooner.
"""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from causalbench.core.numerics import rotations
from causalbench.core.world.layout import Box, box_rows

if TYPE_CHECKING:
    from scipy.sparse import coo_array

Array = NDArray[np.float64]

ROOM_HALF_EXTENTS = (3.6, 3.0)  # m, of the floor between the walls
WALL_HALF_HEIGHT, WALL_HALF_THICKNESS = 1.2, 0.05  # m

_QUARTER = math.pi / 2
FURNITURE = {  # half extents in m; all of it is higher than a scanner at 0.3 m
    "sofa": (0.95, 0.42, 0.40),
    "coffee_table": (0.50, 0.30, 0.22),
    "armchair": (0.38, 0.38, 0.42),
    "table": (0.70, 0.42, 0.37),
    "chair": (0.22, 0.22, 0.45),
    "bookcase": (0.80, 0.16, 0.95),
}
PLANS: tuple[dict[str, tuple[float, float, float]], ...] = (
    {  # seats around a coffee table at one end, dining table at the other
        "sofa": (-3.1, 0.6, _QUARTER),
        "coffee_table": (-1.9, 0.6, _QUARTER),
        "armchair": (-2.4, -2.2, 0.6),
        "table": (2.3, 1.7, 0.0),
        "chair": (1.9, 0.9, 0.2),
        "bookcase": (1.6, -2.8, 0.0),
    },
    {  # a sofa that divides the room
        "sofa": (-0.3, 0.1, 0.0),
        "coffee_table": (-0.3, 1.2, 0.0),
        "armchair": (3.1, 2.5, -0.8),
        "table": (3.1, -1.6, _QUARTER),
        "chair": (2.4, -1.5, 0.1),
        "bookcase": (-3.4, -1.6, _QUARTER),
    },
    {  # dining table in the middle
        "sofa": (0.2, 2.5, 0.0),
        "coffee_table": (-3.1, 2.5, 0.3),
        "armchair": (-3.0, -2.4, 0.8),
        "table": (0.2, -0.3, 0.5),
        "chair": (-0.2, -1.2, 0.5),
        "bookcase": (3.4, 0.6, _QUARTER),
    },
)
"""x m, y m and yaw rad of every piece."""
N_PLANS = len(PLANS)

CELL = 0.1  # m, side of a cell of the ground
CONSTANTS = {
    "room_half_extents": ROOM_HALF_EXTENTS,
    "wall_half_height": WALL_HALF_HEIGHT,
    "wall_half_thickness": WALL_HALF_THICKNESS,
    "furniture": FURNITURE,
    "plans": PLANS,
    "cell": CELL,
}
"""Every number of the rooms, part of the identity of tasks that play in them."""
WAYS_KEPT = 64  # goals whose distances are remembered, for as many worlds as are usually stepped together
_HALF_DIAGONAL = CELL / math.sqrt(2)
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))  # to half of a cell's neighbours; ways go in both directions


@functools.cache
def fixtures(plan: int) -> tuple[Box, ...]:
    """Walls and furniture of room plan `plan`, 0 to `N_PLANS` - 1."""
    (x, y), t, h = ROOM_HALF_EXTENTS, WALL_HALF_THICKNESS, WALL_HALF_HEIGHT
    walls = (
        ("wall_east", (t, y + 2 * t, h), (x + t, 0.0, 0.0)),
        ("wall_west", (t, y + 2 * t, h), (-x - t, 0.0, 0.0)),
        ("wall_north", (x, t, h), (0.0, y + t, 0.0)),
        ("wall_south", (x, t, h), (0.0, -y - t, 0.0)),
    )
    return tuple(
        Box(name, np.array(half), np.array([*place[:2], half[2]]), rotations.from_axis_angle(2, place[2]))
        for name, half, place in (*walls, *((name, FURNITURE[name], place) for name, place in PLANS[plan].items()))
    )


def distance_to(box: Array, points: Array) -> Array:
    """Horizontal distance (...) in metres from `points` (..., 2) to an upright box, a row of `box_rows`; 0 inside."""
    w, z = box[6], box[9]
    cos, sin = w * w - z * z, 2 * w * z
    dx, dy = points[..., 0] - box[3], points[..., 1] - box[4]
    beside = np.abs(np.stack([cos * dx + sin * dy, cos * dy - sin * dx], -1)) - box[:2]
    outside: Array = np.hypot(*np.moveaxis(np.maximum(beside, 0.0), -1, 0))
    return outside


class Ground:
    """Cells of a floor and which of them are free: a circle of radius `clearance` about any of their points is empty.

    Of the free cells only the largest connected part counts. `centres` (nx, ny, 2) m; `free` (nx, ny).
    """

    def __init__(self, boxes: Array, clearance: float) -> None:
        nx, ny = (round(2 * half / CELL) for half in ROOM_HALF_EXTENTS)
        x, y = (CELL * (np.arange(n) + 0.5 - n / 2) for n in (nx, ny))
        self.centres = np.stack(np.meshgrid(x, y, indexing="ij"), -1)
        nearest = np.min([distance_to(box, self.centres) for box in boxes], axis=0)
        self.free = _largest_part(nearest >= clearance + _HALF_DIAGONAL)
        self._graph = _ways_between(self.free)
        self._ways: dict[tuple[int, int], Array] = {}

    def cell(self, point: Array) -> tuple[int, int]:
        """Indices of the cell of `point` (2,), or of the nearest one on the floor."""
        i, j = ((point - self.centres[0, 0]) / CELL).round().astype(int)
        return int(np.clip(i, 0, self.free.shape[0] - 1)), int(np.clip(j, 0, self.free.shape[1] - 1))

    def distances_from(self, point: Array) -> Array:
        """Length (nx, ny) in metres of the shortest way over free cells from that of `point`; infinite elsewhere."""
        cell = self.cell(point)
        if cell not in self._ways:
            from scipy.sparse.csgraph import dijkstra

            if len(self._ways) == WAYS_KEPT:
                del self._ways[next(iter(self._ways))]
            number = int(np.ravel_multi_index(cell, self.free.shape))
            lengths = dijkstra(self._graph, directed=False, indices=number)
            self._ways[cell] = lengths.reshape(self.free.shape)
        return self._ways[cell]

    def waypoint(self, start: Array, goal: Array, ahead: int) -> Array:
        """The point (2,) that lies `ahead` cells on along the shortest way from `start` to `goal`, or the goal."""
        lengths = self.distances_from(goal)
        i, j = self.cell(start)
        for _ in range(ahead):
            low_i, low_j = max(i - 1, 0), max(j - 1, 0)
            window = lengths[low_i : i + 2, low_j : j + 2]
            if not np.isfinite(window).any():  # off the free cells: to the nearest
                window, low_i, low_j = np.where(self.free, self._apart(start), np.inf), 0, 0
            di, dj = np.unravel_index(int(window.argmin()), window.shape)
            i, j = low_i + int(di), low_j + int(dj)
        return goal if lengths[i, j] == 0.0 else self.centres[i, j]

    def _apart(self, point: Array) -> Array:
        return np.hypot(*np.moveaxis(self.centres - point, -1, 0))


def _largest_part(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The largest connected part of `free` (nx, ny), cells that touch at a corner being neighbours."""
    from scipy import ndimage

    parts, _ = ndimage.label(free, np.ones((3, 3)))
    largest: NDArray[np.bool_] = free & (parts == np.bincount(parts[free], minlength=1).argmax())
    return largest


def _ways_between(free: NDArray[np.bool_]) -> coo_array:
    """Lengths in metres of the ways between neighbouring free cells, which are numbered row by row."""
    from scipy.sparse import coo_array

    padded = np.pad(np.where(free, np.arange(free.size).reshape(free.shape), -1), 1, constant_values=-1)
    here = padded[1:-1, 1:-1].ravel()
    pairs, lengths = [], []
    for i, j in _STEPS:
        there = padded[1 + i : padded.shape[0] - 1 + i, 1 + j : padded.shape[1] - 1 + j].ravel()
        both = (here >= 0) & (there >= 0)
        pairs.append(np.stack([here[both], there[both]]))
        lengths.append(np.full(both.sum(), CELL * math.hypot(i, j)))
    return coo_array((np.concatenate(lengths), tuple(np.concatenate(pairs, axis=1))), shape=(free.size, free.size))


def ground(boxes: tuple[Box, ...], clearance: float) -> Ground:
    """The ground among `boxes` for a robot that needs `clearance` metres around it; made once."""
    return _ground(box_rows(boxes).tobytes(), clearance)


@functools.lru_cache(maxsize=16)
def _ground(rows: bytes, clearance: float) -> Ground:
    return Ground(np.frombuffer(rows).reshape(-1, 10), clearance)
