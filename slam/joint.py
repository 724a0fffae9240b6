"""One Gaussian over the pose and the landmarks, beside the particles: the published pose and a covariance that can be
trusted.

The particles' own covariance is hundreds of times too small, because resampling wipes out history. The state holds the
landmarks that can be in view and a choice of the others; the rest hangs on these (slam.joint_window).
"""

import math

import numpy as np
from numpy.typing import NDArray

from slam.estimate import LandmarkMap
from slam.joint_association import PENDING, Gates, associate, follow
from slam.joint_atlas import AWAY, PARENTS, Atlas
from slam.joint_kernels import (
    append,
    block,
    forget,
    neighbour_distances,
    overdue,
    places_within,
    predict,
    update,
)
from slam.joint_measurement import FIRST_PLACE
from slam.joint_settings import JointSettings
from slam.joint_window import ORPHAN, least_needed, nearest_places, regress, restore
from slam.observations import Features, MatchVerdict
from slam.pose import Pose2, wrap_rads
from slam.settings import SlamSettings
from slam.tuning import Tuning

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

IDENTITIES_PER_SCAN = 4096  # as in the particles' maps, so that identities of both can be compared
NO_SIGHT = np.zeros(3)
SMALLEST_VARIANCE = 1e-12  # m^2 and rad^2: keeps the published covariance positive where the map frame is defined
FIRST_ROOM = 64
LOOK_EVERY_M = 2.0  # the rover moves this far before landmarks come back again
KEEP_M = 10.0  # beyond what can be in view: what just came back does not leave at once
LEAVING_PER_SCAN = 8
SHIFTED_M = 1.0  # a jump of the pose after which far landmarks are sorted into cells anew


class JointGaussian:
    """Extended Kalman filter over pose and landmarks with the paper's landmark management."""

    def __init__(self, settings: JointSettings, body_from_laser: Pose2, tuning: Tuning | None = None) -> None:
        self._settings = settings
        self._mount = body_from_laser.as_array()
        self._tuning = SlamSettings().tuning() if tuning is None else tuning
        self._invariant = settings.jacobians == "invariant"
        self._first = settings.jacobians == "first_estimates"
        self._reach_m = self._tuning.range_max_m + self._tuning.range_margin_m
        self._mean = np.zeros(FIRST_PLACE + 2 * FIRST_ROOM)
        self._covariance = np.zeros((len(self._mean), len(self._mean)))
        constants = (settings.distance_scale_sigma, settings.turn_scale_sigma, settings.curvature_sigma_radpm)
        self._covariance[range(3, FIRST_PLACE), range(3, FIRST_PLACE)] = np.square(constants)
        self._linearised_at = np.zeros_like(self._mean)
        self._jump = np.zeros(2)
        self._rows = np.zeros(FIRST_ROOM, dtype=np.int64)
        self._atlas = Atlas(self._tuning.cell_m)
        self._landmarks = 0
        self._looked_at: tuple[float, float] | None = None
        self.scans = 0
        self.refused = 0

    @property
    def map_from_body(self) -> Pose2:
        """The pose at the last scan."""
        return Pose2(*(float(value) for value in self._mean[:3]))

    @property
    def covariance(self) -> FloatArray:
        """(3, 3) over x, y, heading in the map frame: symmetric and positive definite."""
        values, vectors = np.linalg.eigh(self._covariance[:3, :3])
        covariance = (vectors * np.maximum(values, SMALLEST_VARIANCE)) @ vectors.T
        return np.asarray(0.5 * (covariance + covariance.T))

    @property
    def landmark_count(self) -> int:
        """Landmarks in the map."""
        return self._atlas.count

    @property
    def landmarks_in_state(self) -> int:
        """Landmarks in the joint state: what a step costs depends on these."""
        return self._landmarks

    def step(
        self,
        increment_mean: FloatArray,
        increment_covariance: FloatArray,
        features: Features,
        hints: IntArray,
        sight: FloatArray = NO_SIGHT,
    ) -> IntArray:
        """One scan; increment (3,) and (3, 3) since the last one in the body frame of then.

        hints (K,): identities or verdicts of the best particle, used where settings say so. sight: the scan itself as
        slam.kernels takes it, for what should have been seen. Returns this filter's own identities or verdicts (K,).
        A feature that is not finite or whose covariance is not positive definite is refused, counted, and OUT_OF_RANGE.
        """
        at_rest = not (increment_covariance.any() or increment_mean.any())
        self._predict(increment_mean, increment_covariance)
        self._bring_back()
        usable = self._usable(features)
        rows = _rows(features, usable, at_rest)
        sensor = self.map_from_body @ Pose2(*(float(value) for value in self._mount))
        places = places_within(self._mean, self._size, sensor.x_m, sensor.y_m, self._reach_m)
        chosen = self._associate(rows, features.identities[usable], hints[usable], places)
        matched = np.flatnonzero(chosen >= 0)
        self._update(places[chosen[matched]], rows[matched])
        verdicts = np.full(len(features), int(MatchVerdict.OUT_OF_RANGE), dtype=np.int64)
        verdicts[usable] = chosen
        verdicts[usable[matched]] = self._atlas.identities[self._rows[(places[chosen[matched]] - FIRST_PLACE) // 2]]
        self._existence(places, chosen[matched], sight)
        self._create(rows, usable, chosen, features.identities, hints)
        self._put_away()
        self.scans += 1
        return verdicts

    def landmarks(self) -> LandmarkMap:
        """All landmarks of the map; covariances of those far away are as they were when last near."""
        atlas, count = self._atlas, self._landmarks
        points = self._mean[FIRST_PLACE : self._size].reshape(count, 2)
        means = atlas.settled_means(self._rows[:count], points)
        covariances = atlas.covariances.copy()
        places = FIRST_PLACE + 2 * np.arange(count)
        for row in range(2):
            for column in range(2):
                covariances[self._rows[:count], row, column] = self._covariance[places + row, places + column]
        used = np.flatnonzero(atlas.place >= AWAY)
        return LandmarkMap(atlas.identities[used], means[used], covariances[used], atlas.log_odds[used])

    def state_bytes(self) -> bytes:
        """What the next step depends on, for a hash: every change of the state shows in it."""
        n = self._size
        log_odds = self._atlas.log_odds[self._rows[: self._landmarks]]
        return self._mean[:n].tobytes() + self._covariance[:3, :n].tobytes() + log_odds.tobytes()

    @property
    def _size(self) -> int:
        return FIRST_PLACE + 2 * self._landmarks

    def _predict(self, mean: FloatArray, covariance: FloatArray) -> None:
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
            self.refused += 1
            return
        jump_x, jump_y = float(self._jump[0]), float(self._jump[1])
        predict(self._mean, self._covariance, self._size, mean, covariance, jump_x, jump_y)

    def _usable(self, features: Features) -> IntArray:
        c = features.covariances
        with np.errstate(invalid="ignore"):
            determinants = c[:, 0, 0] * c[:, 1, 1] - c[:, 0, 1] * c[:, 1, 0]
            sane = np.isfinite(features.ranges_m) & np.isfinite(features.bearings_rad) & np.isfinite(determinants)
            sane &= (c[:, 0, 0] > 0.0) & (determinants > 0.0) & (features.ranges_m > 0.0)
            usable = sane & (features.ranges_m <= self._tuning.range_max_m)
        self.refused += int((~sane).sum())
        return np.flatnonzero(usable)[:IDENTITIES_PER_SCAN]

    def _associate(self, rows: FloatArray, identities: IntArray, hints: IntArray, places: IntArray) -> IntArray:
        settings = self._settings
        chosen = np.full(len(rows), PENDING, dtype=np.int64)
        order = np.argsort(rows[:, 0], kind="stable")
        mean, covariance = block(self._mean, self._covariance, places)
        told = identities if (identities >= 0).any() else hints if settings.association == "particles" else None
        if told is None:
            gates = Gates(
                settings.match_base_square,
                settings.match_per_metre_square if self._tuning.density else 0.0,
                settings.match_widest_square,
                settings.create_square,
            )
            nearest = neighbour_distances(self._mean, self._size, places)
            associate(mean, covariance, self._mount, nearest, rows, order, gates, chosen)
            return chosen
        gate = settings.match_known_square if told is identities else settings.match_widest_square
        theirs = self._atlas.identities[self._rows[(places - FIRST_PLACE) // 2]]
        follow(mean, covariance, self._mount, theirs, rows, order, told, gate, chosen)
        return chosen

    def _update(self, places: IntArray, rows: FloatArray) -> None:
        if len(places) == 0:
            self._jump[:] = 0.0
            return
        before = self._mean[:2].copy()
        linearised_at = self._linearised_at if self._first else self._mean.copy()
        linearised_at[:3] = self._mean[:3]
        update(self._mean, self._covariance, linearised_at, self._size, self._mount, places, rows, self._invariant)
        jump = self._mean[:2] - before
        self._jump = jump if self._first else np.zeros(2)
        if math.hypot(float(jump[0]), float(jump[1])) > SHIFTED_M:
            points = self._mean[FIRST_PLACE : self._size].reshape(-1, 2)
            self._atlas.sort_anew(self._atlas.settled_means(self._rows[: self._landmarks], points))
            self._looked_at = None

    def _existence(self, places: IntArray, matched: IntArray, sight: FloatArray) -> None:
        """Existence log-odds (6); removes what was missed too often, and what leaves the view unconfirmed."""
        tuning, atlas = self._tuning, self._atlas
        seen = np.zeros(len(places), dtype=np.bool_)
        seen[matched] = True
        numbers = (places - FIRST_PLACE) // 2
        log_odds = atlas.log_odds[self._rows[numbers]]
        overdue(self._mean, places, seen, log_odds, self._mount, sight, tuning)
        atlas.log_odds[self._rows[numbers]] = log_odds
        if not tuning.existence:
            return
        bound = np.full(self._landmarks, self._settings.confirmed_log_odds)
        bound[numbers] = tuning.log_odds_remove
        gone = np.flatnonzero(atlas.log_odds[self._rows[: self._landmarks]] < bound)
        for number in gone[::-1].tolist():
            row = int(self._rows[number])
            self._drop(number)
            atlas.remove(row)

    def _create(
        self, rows: FloatArray, usable: IntArray, chosen: IntArray, identities: IntArray, hints: IntArray
    ) -> None:
        for index in np.flatnonzero(chosen == int(MatchVerdict.NEW)).tolist():
            feature = int(usable[index])
            known = int(identities[feature])
            if known < 0 and self._settings.association == "particles":
                known = int(hints[feature])
            identity = known if known >= 0 else self.scans * IDENTITIES_PER_SCAN + feature
            self._make_room()
            append(self._mean, self._covariance, self._size, self._mount, rows[index])
            self._enter(self._atlas.add(identity, self._tuning.log_odds_new, self._size))

    def _put_away(self) -> None:
        """Landmarks beyond the limit leave the state, the least needed ones first, none that may soon be in view."""
        excess = min(self._landmarks - self._settings.landmarks_in_state, LEAVING_PER_SCAN)
        if excess <= 0:
            return
        points = self._mean[FIRST_PLACE : self._size].reshape(-1, 2)
        away = ((points - self._mean[:2]) ** 2).sum(axis=1) > (self._reach_m + KEEP_M + LOOK_EVERY_M) ** 2
        for _ in range(excess):
            number = least_needed(self._mean, self._size, away)
            if number < 0:
                return
            self._put_one_away(number)
            away[number] = away[self._landmarks]
            away[self._landmarks] = False

    def _put_one_away(self, number: int) -> None:
        atlas, row, at = self._atlas, int(self._rows[number]), FIRST_PLACE + 2 * number
        others = nearest_places(self._mean, self._size, at, PARENTS)
        parents = len(others)
        atlas.means[row] = self._mean[at : at + 2]
        atlas.covariances[row] = self._covariance[at : at + 2, at : at + 2]
        atlas.parents[row] = ORPHAN
        atlas.parents[row, :parents] = self._rows[(others - FIRST_PLACE) // 2]
        atlas.parent_means[row, : 2 * parents] = np.column_stack((self._mean[others], self._mean[others + 1])).ravel()
        weights = np.zeros((2, 2 * parents))
        regress(self._covariance, at, others, weights, atlas.residuals[row])
        atlas.weights[row, :, : 2 * parents] = weights
        self._drop(number)
        atlas.put_away(row)

    def _bring_back(self) -> None:
        """Landmarks that may soon be in view return to the state, with all that they hang on."""
        x, y = float(self._mean[0]), float(self._mean[1])
        if self._looked_at is not None and math.dist((x, y), self._looked_at) < LOOK_EVERY_M:
            return
        self._looked_at = (x, y)
        radius = self._reach_m + LOOK_EVERY_M + 0.5 * KEEP_M
        for row in self._atlas.away_near(x, y, radius):
            gap = self._atlas.means[row] - self._mean[:2]
            if self._atlas.place[row] == AWAY and gap @ gap <= radius * radius:
                self._bring_one_back(row)

    def _bring_one_back(self, row: int) -> None:
        atlas = self._atlas
        parents = atlas.parents[row][atlas.parents[row] >= 0]
        for parent in parents.tolist():
            if atlas.place[parent] == AWAY:
                self._bring_one_back(parent)
        self._make_room()
        n, count = self._size, len(parents)
        others = atlas.place[parents]
        means = np.column_stack((self._mean[others], self._mean[others + 1])).ravel()
        weights = np.ascontiguousarray(atlas.weights[row, :, : 2 * count])
        residual = atlas.residuals[row] if count else atlas.covariances[row]
        moved = means - atlas.parent_means[row, : 2 * count]
        self._mean[n : n + 2] = atlas.means[row] + (weights * moved).sum(axis=1)
        restore(self._covariance, n, others, weights, residual)
        atlas.take_back(row, n)
        self._enter(row)

    def _enter(self, row: int) -> None:
        """The landmark at the end of the state belongs to this row of the atlas."""
        n = self._size
        self._linearised_at[n : n + 2] = self._mean[n : n + 2]
        self._rows[self._landmarks] = row
        self._landmarks += 1

    def _drop(self, number: int) -> None:
        """Take a landmark out of the state; the last one moves to its place."""
        at, last = FIRST_PLACE + 2 * number, self._landmarks - 1
        forget(self._mean, self._covariance, self._size, at)
        self._linearised_at[at : at + 2] = self._linearised_at[self._size - 2 : self._size]
        self._rows[number] = self._rows[last]
        self._atlas.place[self._rows[number]] = at
        self._landmarks = last

    def _make_room(self) -> None:
        room = len(self._rows)
        if self._landmarks < room:
            return
        self._mean = np.concatenate((self._mean, np.zeros(2 * room)))
        self._linearised_at = np.concatenate((self._linearised_at, np.zeros(2 * room)))
        self._rows = np.concatenate((self._rows, np.zeros(room, dtype=np.int64)))
        covariance = np.zeros((len(self._mean), len(self._mean)))
        covariance[: len(self._covariance), : len(self._covariance)] = self._covariance
        self._covariance = covariance


def _rows(features: Features, usable: IntArray, at_rest: bool) -> FloatArray:
    """(K, 6) range, bearing, rr, rb, bb, licence; at rest every feature may create a landmark."""
    c = features.covariances[usable]
    return np.column_stack(
        (
            features.ranges_m[usable],
            wrap_rads(features.bearings_rad[usable]),
            c[:, 0, 0],
            0.5 * (c[:, 0, 1] + c[:, 1, 0]),
            c[:, 1, 1],
            features.may_create[usable] | at_rest,
        )
    )
