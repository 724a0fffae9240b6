"""Finds the motion of a rover whose wheels have said nothing of it: turned on the spot by tens of degrees, or slid.

A scan is tried on earlier ones at every heading and within some metres. The places where most returns coincide are
refined, and judged by what both scans could see: a return in what the other scan saw to be free speaks against them.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.angles import beams_after_first, sees_all_round
from slam.arithmetic.functions import arctangent, cosine_sine, hypotenuse
from slam.arithmetic.small_matrices import applied, eigen, inner, inverse
from slam.compiled import kernel
from slam.front_end.alignment_kernels import EarlierScans
from slam.front_end.alignment_search import Search, narrowing
from slam.front_end.deskew import Beams
from slam.pose import Pose2, wrap_rad

STEP_CELLS = 2  # between positions that are tried
HEADINGS = 120  # around the circle
CELL_M = 0.25  # a cell next to one with a return counts as well
GRID_CELLS = 128  # to a side, around where the motion starts: 16 m each way
MOST_POINTS = 60  # of the new scan while places are sought
REFINED = 6  # best places that are refined
GATES_M = narrowing(0.6, 6)
LOOSE = np.eye(3)  # m^2 and rad^2; nothing is believed of the wheels but that it was not far. It is its own inverse
SAME_M = 0.3  # two returns nearer to each other are one thing
FREE_M = 0.4  # a return so far in front of what the other scan saw there stands in its free space
AGREE_SHARE = 0.97  # of the returns that can be compared lie where the other scan has one
COMPARED_SHARE = 0.35  # of all returns can be compared
LEAST_SAME_RAD = 1.7  # of view that coincides, in both scans together: less shows a wall and a corner, as elsewhere
RIVAL_SHARE = 0.85  # another place that agrees by so much of the best one's lead: places that look alike
RIVAL_SQUARE = 30.0  # squared distance from which it is another place
SHIFTS_M = np.concatenate((-np.arange(0.5, 3.05, 0.1), np.arange(0.5, 3.05, 0.1)))  # pillars, windows and doors in rows
REPEATED_SHARE = 0.97  # of the returns that can be compared then: a place as good as the one found


class Field(NamedTuple):
    """Motions that are tried: so many steps of position and of heading to either side of the wheels'; how much better
    than that by the wheels one must be, as a share of the returns that can be compared.
    """

    steps: int
    headings: int
    lead_share: float

    def holds(self, off: FloatArray) -> bool:
        """Whether a motion off (3,) from the wheels' lies in it, or a step beyond."""
        turned = abs(math.remainder(off[2], 2.0 * math.pi)) / (2.0 * math.pi / HEADINGS)
        return max(abs(off[0]), abs(off[1])) <= (self.steps + 1) * STEP_CELLS * CELL_M and turned <= self.headings + 1


SLID = Field(6, 8, 0.2)  # by 3 m, turned by 24 deg at most
TURNED = Field(1, HEADINGS // 2, 0.5)  # on the spot, by any angle


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One scan: points_m (n, 2) of its beams in order, in its laser's frame, NaN where nothing came back."""

    points_m: FloatArray
    first_rad: float
    spacing_rad: float

    @classmethod
    def of(cls, beams: Beams) -> "View":
        """Of a scan's beams."""
        return cls(beams.points_m, arctangent(beams.rays[0, 1], beams.rays[0, 0]), beams.spacing_rad)


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How many returns of two scans coincide, and how many stand in what the other scan saw to be free."""

    same: int
    free: int

    @property
    def compared(self) -> int:
        """Returns of which the other scan says anything."""
        return self.same + self.free

    @property
    def lead(self) -> int:
        """By how much more speaks for the motion than against it."""
        return self.same - self.free


class Found(NamedTuple):
    """A motion (3,), its information (3, 3), and the share of the new scan's points that lie on earlier surfaces."""

    motion: FloatArray
    information: FloatArray
    share: float


Known = Callable[[Beams, FloatArray, FloatArray], bool]
"""Whether a map knows the scan near a motion (3,) with its covariance (3, 3) from where the rover was."""


def unknown(_beams: Beams, _motion: FloatArray, _covariance: FloatArray) -> bool:
    """There is no map."""
    return False


@dataclass(frozen=True, slots=True, eq=False)
class WideSearch:
    """search: the new scan's points and earlier scans. new, last: this scan and the one before."""

    search: Search
    new: View
    last: View
    body_from_laser: Pose2

    def best(self, by_wheels: FloatArray) -> Found | None:
        """None where no motion is clearly right, and clearly better than that by the wheels (3,)."""
        return self._clear_place(by_wheels, (SLID, TURNED), self.agreement(by_wheels).lead)

    def nearby(self, predicted: FloatArray) -> Found | None:
        """The same about as turned as predicted (3,), whether or not it is a better place than that."""
        return self._clear_place(predicted, (SLID,), -math.inf)

    def _clear_place(self, by_wheels: FloatArray, fields: tuple[Field, ...], least_lead: float) -> Found | None:
        """The motion that stands out in the fields around that by the wheels (3,), if it leads by more than that."""
        past = self.search.past
        last = past._replace(points_m=past.points_m[:1], normals=past.normals[:1], from_start=past.from_start[:1])
        onto_last = Search(self.search.points_m, last)
        found = []
        for field in fields:
            for start in self._places(by_wheels, field):
                motion, information, _ = onto_last.refined(by_wheels, LOOSE, start, GATES_M)
                if field.holds(motion - by_wheels):
                    found.append((self.agreement(motion), motion, information, field))
        if not found:
            return None
        best, motion, information, field = max(found, key=lambda place: place[0].lead)
        if best.same * self.new.spacing_rad < LEAST_SAME_RAD or not self._says_the_same(best, AGREE_SHARE):
            return None
        if best.lead - least_lead < field.lead_share * best.compared:
            return None
        for other, elsewhere, _, its_field in found:
            off = elsewhere - motion
            off[2] = wrap_rad(float(off[2]))
            alike = other.lead > RIVAL_SHARE * best.lead and inner(off, applied(information, off)) > RIVAL_SQUARE
            if alike and (its_field is field or field is TURNED):  # a corridor looks the same from its other end
                return None
        motion, information, count = self.search.refined(by_wheels, LOOSE, motion, GATES_M[-1:])
        if self._is_repeated(motion, information):
            return None
        return Found(motion, information, count / len(self.search.points_m))

    def _is_repeated(self, motion: FloatArray, information: FloatArray) -> bool:
        """Whether places along the direction in which the motion is known least are as good."""
        _, directions = eigen(inverse(information)[:2, :2])
        least_known = np.array((*directions[:, -1], 0.0))
        shifted = (self.agreement(motion + shift_m * least_known) for shift_m in SHIFTS_M)
        return any(self._says_the_same(agreement, REPEATED_SHARE) for agreement in shifted)

    def _says_the_same(self, agreement: Agreement, least_share: float) -> bool:
        """Whether enough returns can be compared, and at least this share of them coincide."""
        returned = sum(int((~np.isnan(view.points_m[:, 0])).sum()) for view in (self.new, self.last))
        return agreement.compared >= COMPARED_SHARE * returned and agreement.same >= least_share * agreement.compared

    def agreement(self, motion: FloatArray) -> Agreement:
        """What both scans say of a motion (3,)."""
        last_from_new = self.body_from_laser.inverse() @ Pose2(*motion.tolist()) @ self.body_from_laser
        same, free = 0, 0
        for seen, onto, pose in (
            (self.new, self.last, last_from_new),
            (self.last, self.new, last_from_new.inverse()),
        ):
            alike, inside = compare(seen.points_m, pose.as_array(), onto.points_m, onto.first_rad, onto.spacing_rad)
            same, free = same + alike, free + inside
        return Agreement(same, free)

    def _places(self, by_wheels: FloatArray, field: Field) -> list[FloatArray]:
        """Motions (3,) in a field under which most points fall next to earlier returns, well apart from each other."""
        points = self.search.points_m
        points = np.ascontiguousarray(points[:: -(-len(points) // MOST_POINTS)])
        headings = by_wheels[2] + 2.0 * math.pi / HEADINGS * np.arange(
            -field.headings, min(field.headings + 1, HEADINGS - field.headings)
        )
        hits = coincidences(points, occupied_cells(self.search.past), by_wheels[:2], headings, field.steps)
        side = 2 * field.steps + 1
        order = np.argsort(-hits, axis=None, kind="stable")[: 40 * REFINED]
        chosen: list[tuple[int, int, int]] = []
        for flat in order.tolist():
            turn, rest = divmod(flat, side * side)
            place = (turn, *divmod(rest, side))
            if all(_apart(place, other) for other in chosen):
                chosen.append(place)
            if len(chosen) == REFINED:
                break
        step_m = STEP_CELLS * CELL_M
        return [
            np.array((*(by_wheels[:2] + step_m * (np.array(place[1:]) - field.steps)), headings[place[0]]))
            for place in chosen
        ]


def _apart(one: tuple[int, int, int], other: tuple[int, int, int]) -> bool:
    turns = abs(one[0] - other[0])
    return min(turns, HEADINGS - turns) > 2 or max(abs(one[1] - other[1]), abs(one[2] - other[2])) > 1


def occupied_cells(past: EarlierScans) -> BoolArray:
    """(GRID_CELLS, GRID_CELLS) cells with a return of an earlier scan in or next to them, where the motion starts."""
    cells = np.zeros((GRID_CELLS, GRID_CELLS), dtype=np.bool_)
    for points, (x, y, cosine, sine) in zip(past.points_m, past.from_start, strict=True):
        off = points[~np.isnan(points[:, 0])] - (x, y)
        start = np.column_stack((cosine * off[:, 0] + sine * off[:, 1], cosine * off[:, 1] - sine * off[:, 0]))
        at: IntArray = np.floor(start / CELL_M).astype(np.int64) + GRID_CELLS // 2
        at = at[((at > 0) & (at < GRID_CELLS - 1)).all(axis=1)]
        for row in (-1, 0, 1):
            for column in (-1, 0, 1):
                cells[at[:, 0] + row, at[:, 1] + column] = True
    return cells


@kernel
def coincidences(
    points_m: FloatArray, cells: BoolArray, centre_m: FloatArray, headings: FloatArray, steps: int
) -> IntArray:
    """(h, s, s) points (p, 2) that fall into a cell, by heading and position, so many steps to either side of centre_m
    (2,).
    """
    side = 2 * steps + 1
    hits = np.zeros((headings.size, side, side), dtype=np.int64)
    for turn in range(headings.size):
        cosine, sine = cosine_sine(headings[turn])
        for point in range(points_m.shape[0]):
            x = centre_m[0] + cosine * points_m[point, 0] - sine * points_m[point, 1]
            y = centre_m[1] + sine * points_m[point, 0] + cosine * points_m[point, 1]
            row = math.floor(x / CELL_M) + GRID_CELLS // 2 - steps * STEP_CELLS
            column = math.floor(y / CELL_M) + GRID_CELLS // 2 - steps * STEP_CELLS
            for i in range(side):
                at = row + STEP_CELLS * i
                if at < 0 or at >= GRID_CELLS:
                    continue
                for j in range(side):
                    beside = column + STEP_CELLS * j
                    if 0 <= beside < GRID_CELLS and cells[at, beside]:
                        hits[turn, i, j] += 1
    return hits


@kernel
def compare(
    points_m: FloatArray, pose: FloatArray, onto_m: FloatArray, first_rad: float, spacing_rad: float
) -> tuple[int, int]:
    """How many points (n, 2) coincide with a return of another scan, beams onto_m (m, 2), and how many stand in front
    of what it saw there.

    pose (3,): the points' laser in the other's frame. What lies behind its returns or outside its view says nothing.
    """
    cosine, sine = cosine_sine(pose[2])
    same, free, size = 0, 0, onto_m.shape[0]
    is_ring = sees_all_round(spacing_rad, size)
    for point in range(points_m.shape[0]):
        if math.isnan(points_m[point, 0]):
            continue
        x = pose[0] + cosine * points_m[point, 0] - sine * points_m[point, 1]
        y = pose[1] + sine * points_m[point, 0] + cosine * points_m[point, 1]
        distance = math.sqrt(x * x + y * y)
        beam = round(beams_after_first(arctangent(y, x), first_rad, spacing_rad, size))
        if beam < 0 or beam >= size or distance < SAME_M:
            continue
        reach = 1 + int(min(SAME_M / distance / spacing_rad, 20.0))
        nearest, range_m = math.inf, math.inf
        low, high = beam - reach, beam + reach + 1
        if not is_ring:
            low, high = max(low, 0), min(high, size)
        for turned in range(low, high):
            at = turned % size
            if math.isnan(onto_m[at, 0]):
                if abs(turned - beam) <= 1:
                    range_m = 0.0  # nothing came back there: what stands there is not known
                continue
            dx, dy = onto_m[at, 0] - x, onto_m[at, 1] - y
            nearest = min(nearest, dx * dx + dy * dy)
            if abs(turned - beam) <= 1:
                range_m = min(range_m, hypotenuse(onto_m[at, 0], onto_m[at, 1]))
        if nearest < SAME_M * SAME_M:
            same += 1
        elif distance < range_m - FREE_M:
            free += 1
    return same, free
