"""One attempt to recognise a place: local points laid onto a map, in slices of bounded work.

`recognise` makes it at once. The same points in the mirror, which are in no map, are tried beside them: what those
reach is what chance reaches here.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray, IntArray
from slam.arithmetic.elementary import exponential, logarithm, squared
from slam.arithmetic.functions import lengths
from slam.pose import Pose2, wrap_rad
from slam.recognise.map_index import FREE, IndexedMap, MapIndex
from slam.recognise.prior import PosePrior, region_of
from slam.recognise.scale import Scale
from slam.recognise.search_kernels import (
    AT,
    REFINED_GATE_SIGMAS,
    SAME_M,
    SAME_RAD,
    TASK,
    Candidates,
    Searched,
    match,
    refine,
    search,
)

LEAST_POINTS = 4
MOST_POINTS = 48  # the most exact ones
MOST_LOCAL_PAIRS = 40
PAIRS_OF_A_POINT = 3
USEFUL_LENGTH_M = 15.0  # a longer pair does not tell the heading better, since the map is bent
LENGTH_SIGMAS = 2.5
KEPT_POSES = 64
LOOKS_A_SLICE = 120_000  # about 3 ms
ODDS, LEAST_MATCHES, LEAST_SHARE = 14.0, 6, 0.4
LEAST_TOLD = 4  # matches, where somebody has said where the rover is
OVER_MIRROR = 5.0
LEAST_RIVALS, MOST_RIVALS = 4, 10  # places that look alike, from which the tail is estimated
NEGLIGIBLE = 30.0  # smaller than the best by more, in logarithms, a rival has no mass
LEAST_WRONG = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class LocalPoints:
    """Landmarks around the rover as it sees them now.

    points_m (n, 2) in the body's frame with their joint covariance_m2 (2 n, 2 n); identities (n,) and log_odds (n,) of
    existence in the map that they come from.
    """

    identities: IntArray
    points_m: FloatArray
    covariance_m2: FloatArray
    log_odds: FloatArray

    def __len__(self) -> int:
        return len(self.identities)

    @property
    def variances_m2(self) -> FloatArray:
        """(n,) mean of both axes."""
        values: FloatArray = 0.5 * np.diag(self.covariance_m2).reshape(-1, 2).sum(axis=1)
        return values

    def nearest(self, count: int) -> "LocalPoints":
        """So many of them, or all."""
        return self._only(np.sort(np.argsort(lengths(self.points_m), kind="stable")[:count]))

    def within(self, reach_m: float, also: IntArray) -> "LocalPoints":
        """Those no farther away than that, and those of these identities."""
        return self._only(np.flatnonzero((lengths(self.points_m) <= reach_m) | np.isin(self.identities, also)))

    def _only(self, kept: IntArray) -> "LocalPoints":
        both = np.column_stack((2 * kept, 2 * kept + 1)).ravel()
        covariance = self.covariance_m2[np.ix_(both, both)]
        return LocalPoints(self.identities[kept], self.points_m[kept], covariance, self.log_odds[kept])


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """The best that an attempt found.

    odds: natural logarithm, against chance, every other place and "not in the map"; mirror_odds: what the same points
    reached in the mirror. local, known (k,): identities of the matched landmarks in both maps. points: how many local
    ones there were. is_told: only the places within a prior were looked at. by_scans: the pose is known by how
    scans lie on the map, and the matches are what stands there.
    """

    map_from_body: Pose2
    odds: float
    mirror_odds: float
    local: IntArray
    known: IntArray
    points: int
    is_told: bool = False
    by_scans: bool = False

    @property
    def probability_wrong(self) -> float:
        """As it is published: ten times the odds' own, and never below what trials can show."""
        return max(10.0 * exponential(-self.odds), LEAST_WRONG) if self.odds > 0.0 else 1.0

    @property
    def acceptable(self) -> bool:
        """Whether it may be the place; see slam.recognise.confirmation for what is needed besides."""
        matches = len(self.known)
        enough = matches >= (LEAST_TOLD if self.is_told else LEAST_MATCHES) and matches >= LEAST_SHARE * self.points
        return enough and self.odds >= max(ODDS, self.mirror_odds + OVER_MIRROR)


NOTHING = Hypothesis(Pose2(), -math.inf, -math.inf, np.empty(0, np.int64), np.empty(0, np.int64), 0)


class Attempt:
    """points against a map as it was when the attempt began. No random part: a replay repeats it."""

    def __init__(self, scale: Scale, known: IndexedMap, points: LocalPoints, prior: PosePrior | None = None) -> None:
        """prior: where the rover is said to be; no other place is looked at."""
        self._known, self._is_told = known, prior is not None
        chosen = np.argsort(points.variances_m2, kind="stable")[:MOST_POINTS]
        self._identities = points.identities[chosen]
        variances = points.variances_m2[chosen] + squared(scale.sigma_m)
        self._sides = []
        if len(chosen) >= LEAST_POINTS:
            task = searched(known, points.points_m[chosen], variances, scale, prior)
            mirrored = task._replace(points_m=task.points_m * (1.0, -1.0))
            self._sides = [_Side(known, task), _Side(known, mirrored)]

    def advance(self, most_looks: int = LOOKS_A_SLICE) -> Hypothesis | None:
        """Do a slice of the work; the result when that was the last one, and in every call after it."""
        for side in self._sides:
            most_looks -= side.advance(most_looks)
            if most_looks <= 0:
                return None
        if not self._sides:
            return NOTHING
        side, mirror = self._sides
        pose, matches, factors = side.best()
        mirrored = mirror.best()[2]
        matched = np.flatnonzero(matches != FREE)
        return Hypothesis(
            pose,
            odds_of(factors, [*factors[1:], *mirrored]),
            odds_of(mirrored, [*mirrored[1:], *factors[1:]]),
            self._identities[matched],
            self._known.identities[matches[matched]],
            len(self._identities),
            self._is_told,
        )

    @property
    def state(self) -> tuple[int, ...]:
        """How far it has come."""
        return tuple(count for side in self._sides for count in side.progress)


def recognise(index: MapIndex, points: LocalPoints, prior: PosePrior | None = None) -> Hypothesis:
    """Where in the map the local points are, found at once; whether it is to be believed, its odds say."""
    attempt = Attempt(index.scale, index.indexed, points, prior)
    while (hypothesis := attempt.advance()) is None:
        pass
    return hypothesis


def at_place(index: MapIndex, points: LocalPoints, place: Hypothesis) -> Hypothesis:
    """The same place with the local points that have a landmark of the map where they should be."""
    known = index.indexed
    task = searched(known, points.points_m, points.variances_m2 + squared(index.scale.sigma_m), index.scale, None)
    matches = np.full(len(points), FREE, dtype=np.int64)
    if len(points) and len(index):
        takers = np.full(len(known.identities), FREE, dtype=np.int64)
        match(task, known, place.map_from_body.as_array(), REFINED_GATE_SIGMAS, takers, matches)
    matched = np.flatnonzero(matches != FREE)
    local, landmarks = points.identities[matched], known.identities[matches[matched]]
    return replace(place, local=local, known=landmarks, points=len(points))


class _Side:
    """The points or their mirror image."""

    def __init__(self, known: IndexedMap, task: Searched) -> None:
        self._known, self._task = known, task
        self._cursor = np.zeros(2, dtype=np.int64)
        if len(task.pairs):
            self._cursor[AT] = task.bounds[0, 0]
        self._found = Candidates(np.zeros((KEPT_POSES, 3)), np.full(KEPT_POSES, -math.inf))
        self._refined = 0
        self._factors = np.full(KEPT_POSES, -math.inf)
        self._matches = np.full((KEPT_POSES, len(task.points_m)), FREE, dtype=np.int64)
        self._takers = np.full(len(known.identities), FREE, dtype=np.int64)

    @property
    def progress(self) -> tuple[int, int, int]:
        """Cursor of the search, and poses refined."""
        return int(self._cursor[TASK]), int(self._cursor[AT]), self._refined

    def advance(self, most_looks: int) -> int:
        """Search, then refine; returns about how many points were looked up."""
        looks = search(self._task, self._known, self._cursor, most_looks, self._found)
        if self._cursor[TASK] < len(self._task.pairs):
            return looks
        while self._refined < KEPT_POSES and looks < most_looks:
            number = self._refined
            if self._found.ratios[number] > -math.inf:
                pose = self._found.poses[number]
                self._factors[number] = refine(self._task, self._known, pose, self._takers, self._matches[number])
                looks += 8 * len(self._task.points_m)
            self._refined += 1
        return looks if self._refined == KEPT_POSES else most_looks

    def best(self) -> tuple[Pose2, NDArray[np.int64], list[float]]:
        """The pose with the largest Bayes factor, its matches (n,), and the logarithms of this one and of all rivals
        that are not negligible or that chance has lifted above 0, the largest first.
        """
        order = np.argsort(-self._factors, kind="stable")
        order = order[self._factors[order] > min(float(self._factors[order[0]]) - NEGLIGIBLE, 0.0)]
        apart: list[int] = []
        for number in order.tolist():
            if not any(_same(self._found.poses[number], self._found.poses[other]) for other in apart):
                apart.append(number)
        if not apart:
            return Pose2(), np.full(len(self._task.points_m), FREE), []
        best = apart[0]
        return Pose2(*self._found.poses[best].tolist()), self._matches[best], self._factors[apart].tolist()


def odds_of(factors: list[float], chance: list[float]) -> float:
    """Odds of the first log Bayes factor against the others and "not in the map", which weighs as much as all places.

    chance: factors that chance has reached here. Where things stand in rows it reaches far, and its best is far above
    its second best: the odds are counted in units of how far such factors are apart.
    """
    if not factors:
        return -math.inf
    others = [logarithm(0.5), *(logarithm(0.5) + factor for factor in factors[1:])]
    largest = max(others)
    everything = largest + logarithm(sum(exponential(other - largest) for other in others))
    odds = logarithm(0.5) + factors[0] - everything
    return odds / spacing(chance) if odds > 0.0 else odds


def spacing(chance: list[float]) -> float:
    """Scale of the exponential tail of the factors that are above 0; at least 1, as where next to none is."""
    largest = sorted((factor for factor in chance if factor > 0.0), reverse=True)[: MOST_RIVALS + 1]
    if len(largest) < LEAST_RIVALS:
        return 1.0
    return max(1.0, sum(largest[:-1]) / (len(largest) - 1) - largest[-1])


def searched(
    known: IndexedMap, points_m: FloatArray, variances_m2: FloatArray, scale: Scale, prior: PosePrior | None
) -> Searched:
    """Which pairs of the local points (n, 2) are tried: long, exact ones of a length that is rare in the map."""
    count = len(points_m)
    first, second = np.triu_indices(count, 1)
    lengths_m = lengths(points_m[second] - points_m[first])
    tolerances = LENGTH_SIGMAS * np.sqrt(variances_m2[first] + variances_m2[second])
    low = np.searchsorted(known.pairs.lengths_m, (lengths_m - tolerances).astype(np.float32), side="left")
    high = np.searchsorted(known.pairs.lengths_m, (lengths_m + tolerances).astype(np.float32), side="right")
    own = variances_m2[first] + variances_m2[second] - 2.0 * squared(scale.sigma_m)
    cost = (high - low) * (1.0 + own) / np.sqrt(np.minimum(lengths_m, USEFUL_LENGTH_M) + 1e-9)
    used = np.zeros(count, dtype=np.int64)
    chosen: list[int] = []
    for pair in np.argsort(cost, kind="stable").tolist():
        a, b = first[pair], second[pair]
        usable = high[pair] > low[pair] and lengths_m[pair] >= scale.shortest_pair_m
        if usable and used[a] < PAIRS_OF_A_POINT and used[b] < PAIRS_OF_A_POINT and len(chosen) < MOST_LOCAL_PAIRS:
            used[[a, b]] += 1
            chosen.append(pair)
    pairs = np.column_stack((first[chosen], second[chosen])).astype(np.int64)
    orders = np.zeros((len(chosen), max(count - 2, 0)), dtype=np.int64)
    for number, (a, b) in enumerate(pairs.tolist()):
        far = lengths(points_m - 0.5 * (points_m[a] + points_m[b]))
        order = np.argsort(far, kind="stable")
        orders[number] = order[(order != a) & (order != b)]
    bounds = np.column_stack((low[chosen], high[chosen])).astype(np.int64)
    bent_m2 = squared(scale.sigma_m) - squared(scale.same_sigma_m)
    return Searched(np.ascontiguousarray(points_m), variances_m2, pairs, bounds, orders, bent_m2, region_of(prior))


def _same(pose: FloatArray, other: FloatArray) -> bool:
    apart = math.hypot(pose[0] - other[0], pose[1] - other[1])
    return apart < SAME_M and abs(wrap_rad(float(pose[2] - other[2]))) < SAME_RAD
