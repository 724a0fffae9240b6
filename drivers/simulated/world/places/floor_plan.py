"""The floor of an office building: a ring of corridors with rooms on both sides, drawn from a seed."""

import itertools
from dataclasses import dataclass, field

import numpy as np

from drivers.measurements import BoolArray, FloatArray
from drivers.simulated.world.places.doors import WIDTH_M, Doors

RING_M = (61.0, 15.5)  # centre line of the corridors; with its rounded corners a lap is 150 m
HALF_WIDTH_M = 1.2
INNER_DEPTH_M, OUTER_DEPTH_M, HALL_DEPTH_M = 6.4, 5.0, 10.0
REVEAL_M = 0.12  # a closed door stands this far behind the wall of the corridor
ROOM_WIDTH_M = (3.0, 6.0)
GLASS_FRONTS, NICHES, STORES = 0.12, 0.06, 0.12  # shares of the rooms
BEYOND_M = 6.0  # what can be seen through the windows of the hall ends here


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlan:
    """Segments (s, 2) to (s, 2), which of them are glass (s,); round things (c, 2) with radii (c,); the doors."""

    starts_m: FloatArray
    ends_m: FloatArray
    glass: BoolArray
    circles_m: FloatArray
    radii_m: FloatArray
    doors: Doors


@dataclass(slots=True)
class _Drawing:
    """Segments and round things while they are drawn, in the frame of one wall after the other.

    origin and along: the wall of the corridor; inward: into the rooms behind it.
    """

    rng: np.random.Generator
    origin: FloatArray = field(default_factory=lambda: np.zeros(2))
    along: FloatArray = field(default_factory=lambda: np.zeros(2))
    inward: FloatArray = field(default_factory=lambda: np.zeros(2))
    segments: list[tuple[FloatArray, FloatArray, bool]] = field(default_factory=list)
    circles: list[tuple[FloatArray, float]] = field(default_factory=list)
    hinges: list[tuple[FloatArray, FloatArray, FloatArray]] = field(default_factory=list)

    def face(self, begin: FloatArray, end: FloatArray, inward: FloatArray) -> float:
        """Go on with the wall from begin to end; its length."""
        length = float(np.hypot(*(end - begin)))
        self.origin, self.along, self.inward = begin, (end - begin) / length, inward
        return length

    def at(self, along_m: float, inward_m: float) -> FloatArray:
        """A point of the wall's frame in the map."""
        return self.origin + along_m * self.along + inward_m * self.inward

    def wall(self, *corners: tuple[float, float], glass: bool = False) -> None:
        """Walls from corner to corner."""
        points = [self.at(*corner) for corner in corners]
        self.segments += [(a, b, glass) for a, b in itertools.pairwise(points)]

    def box(self, along_m: float, inward_m: float, width_m: float, depth_m: float) -> None:
        """A cupboard, a desk, a pilaster: its near left corner and its size."""
        right, far = along_m + width_m, inward_m + depth_m
        self.wall((along_m, inward_m), (right, inward_m), (right, far), (along_m, far), (along_m, inward_m))

    def post(self, along_m: float, inward_m: float, radius_m: float) -> None:
        """A leg, a bin, a column."""
        self.circles.append((self.at(along_m, inward_m), radius_m))

    def door(self, along_m: float) -> None:
        """A door in its reveal, hinged on a side that is drawn."""
        hinge, latch = along_m, along_m + WIDTH_M
        self.wall((hinge, 0.0), (hinge, REVEAL_M))
        self.wall((latch, 0.0), (latch, REVEAL_M))
        if self.rng.random() < 0.5:
            hinge, latch = latch, hinge
        closed = self.at(latch, REVEAL_M) - self.at(hinge, REVEAL_M)
        self.hinges.append((self.at(hinge, REVEAL_M), closed / WIDTH_M, self.inward))


def draw_floor(rng: np.random.Generator) -> FloorPlan:
    """A building; the middle of its first corridor is the map's origin."""
    drawing = _Drawing(rng)
    half, depth = 0.5 * RING_M[0], RING_M[1]
    low, high = -half - HALF_WIDTH_M, half + HALF_WIDTH_M
    outer = [np.array(corner) for corner in ((low, -HALF_WIDTH_M), (high, -HALF_WIDTH_M))]
    outer += [np.array(corner) for corner in ((high, depth + HALF_WIDTH_M), (low, depth + HALF_WIDTH_M))]
    low, high = -half + HALF_WIDTH_M, half - HALF_WIDTH_M
    inner = [np.array(corner) for corner in ((low, HALF_WIDTH_M), (high, HALF_WIDTH_M))]
    inner += [np.array(corner) for corner in ((high, depth - HALF_WIDTH_M), (low, depth - HALF_WIDTH_M))]
    down, right, up, left = (np.array(way) for way in ((0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)))
    _rooms(drawing, outer[0], outer[1], down, OUTER_DEPTH_M)
    _hall(drawing, outer[1], outer[2], right)
    _rooms(drawing, outer[2], outer[3], up, OUTER_DEPTH_M)
    _rooms(drawing, outer[3], outer[0], left, OUTER_DEPTH_M)
    _rooms(drawing, inner[0], inner[1], up, INNER_DEPTH_M)
    _rooms(drawing, inner[2], inner[3], down, INNER_DEPTH_M)
    for begin, end, inward in ((inner[1], inner[2], left), (inner[3], inner[0], right)):
        length = drawing.face(begin, end, inward)
        drawing.wall((0.0, 0.0), (length, 0.0))
        _corridor_furniture(drawing, np.arange(1.0, length - 1.0, 4.0))
    starts, ends, glass = zip(*drawing.segments, strict=True)
    centres, radii = zip(*drawing.circles, strict=True)
    hinges, closed, inwards = (np.array(column) for column in zip(*drawing.hinges, strict=True))
    doors = Doors(hinges, closed, inwards, rng)
    return FloorPlan(np.array(starts), np.array(ends), np.array(glass), np.array(centres), np.array(radii), doors)


def _rooms(drawing: _Drawing, begin: FloatArray, end: FloatArray, inward: FloatArray, depth_m: float) -> None:
    """Rooms side by side behind the wall from begin to end, and their fronts."""
    rng, length = drawing.rng, drawing.face(begin, end, inward)
    borders = [0.0]
    while borders[-1] < length - ROOM_WIDTH_M[1] - ROOM_WIDTH_M[0]:
        borders.append(borders[-1] + rng.uniform(*ROOM_WIDTH_M))
    borders.append(length)
    drawing.wall((0.0, depth_m), (length, depth_m))
    for border in borders:
        drawing.wall((border, 0.0), (border, depth_m))
    for left, right in itertools.pairwise(borders):
        kind = rng.random()
        if kind < STORES:
            drawing.wall((left, 0.0), (right, 0.0))
            continue
        if kind > STORES + NICHES:  # a niche is open to the corridor: printers, coats
            glazed = kind > 1.0 - GLASS_FRONTS
            door = rng.uniform(left + 0.3, right - WIDTH_M - 0.3)
            drawing.wall((left, 0.0), (door, 0.0), glass=glazed)
            drawing.wall((door + WIDTH_M, 0.0), (right, 0.0), glass=glazed)
            drawing.door(door)
        _room_furniture(drawing, left, right, depth_m)
    _corridor_furniture(drawing, np.array(borders[1:-1]))


def _room_furniture(drawing: _Drawing, left_m: float, right_m: float, depth_m: float) -> None:
    """Cupboards along the rear wall, a desk or two, legs of chairs and tables."""
    rng = drawing.rng
    for _ in range(rng.integers(1, 3)):
        width = rng.uniform(0.6, 1.4)
        drawing.box(rng.uniform(left_m + 0.1, right_m - width - 0.1), depth_m - 0.45, width, 0.4)
    for _ in range(rng.integers(0, 3)):
        across, deep = rng.uniform(0.5, 0.8), rng.uniform(1.0, 1.6)
        side = left_m + 0.05 if rng.random() < 0.5 else right_m - across - 0.05
        drawing.box(side, rng.uniform(1.4, depth_m - 2.2), across, deep)
    for _ in range(rng.integers(2, 7)):
        drawing.post(rng.uniform(left_m + 0.9, right_m - 0.9), rng.uniform(1.4, depth_m - 0.8), rng.uniform(0.02, 0.04))


def _corridor_furniture(drawing: _Drawing, borders_m: FloatArray) -> None:
    """Between two rooms, on the corridor's side of the wall: a pilaster, a cupboard, a bin, mostly nothing."""
    rng = drawing.rng
    for border in borders_m:
        thing = rng.random()
        if thing < 0.15:
            drawing.box(border - 0.2, -0.12, 0.4, 0.12)
        elif thing < 0.25:
            drawing.box(border - 0.15, -0.32, 0.3, 0.3)
        elif thing < 0.35:
            drawing.post(float(border), -0.2, rng.uniform(0.12, 0.16))


def _hall(drawing: _Drawing, begin: FloatArray, end: FloatArray, inward: FloatArray) -> None:
    """An entrance hall with columns, open to the corridor, windows to the yard at its far side."""
    rng, length = drawing.rng, drawing.face(begin, end, inward)
    drawing.wall((0.0, 0.0), (2.0, 0.0), (2.0, HALL_DEPTH_M), (4.0, HALL_DEPTH_M))
    drawing.wall((length, 0.0), (length - 2.0, 0.0), (length - 2.0, HALL_DEPTH_M), (length - 4.0, HALL_DEPTH_M))
    drawing.wall((4.0, HALL_DEPTH_M), (length - 4.0, HALL_DEPTH_M), glass=True)
    drawing.wall((-BEYOND_M, HALL_DEPTH_M + BEYOND_M), (length + BEYOND_M, HALL_DEPTH_M + BEYOND_M))
    for along in np.linspace(4.0, length - 4.0, 3):
        for deep in (1.0, 5.0):
            drawing.post(float(along), deep, 0.22)
    drawing.box(length / 2.0 - 1.5, 7.0, 3.0, 0.7)
    for _ in range(8):
        drawing.post(rng.uniform(2.5, length - 2.5), rng.uniform(6.0, 9.5), rng.uniform(0.02, 0.04))
