"""One Gaussian over the pose and the landmarks, beside the particles: the published pose and a covariance that can be
trusted.

The particles' own covariance is hundreds of times too small, because resampling wipes out history.
"""

import math

import numpy as np
from numpy.typing import NDArray

from slam.estimate import LandmarkMap
from slam.joint_association import PENDING, Gates, associate, follow
from slam.joint_kernels import append, block, forget, predict, update
from slam.joint_settings import JointSettings
from slam.kernels import in_clear_view
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


class JointGaussian:
    """Extended Kalman filter over pose and landmarks with the paper's landmark management."""

    def __init__(self, settings: JointSettings, body_from_laser: Pose2, tuning: Tuning | None = None) -> None:
        self._settings = settings
        self._mount = body_from_laser.as_array()
        self._tuning = SlamSettings().tuning() if tuning is None else tuning
        self._invariant = settings.jacobians == "invariant"
        self._first = settings.jacobians == "first_estimates"
        self._mean = np.zeros(3 + 2 * FIRST_ROOM)
        self._covariance = np.zeros((3 + 2 * FIRST_ROOM, 3 + 2 * FIRST_ROOM))
        self._linearised_at = np.zeros_like(self._mean)
        self._jump = np.zeros(2)
        self._identities = np.zeros(FIRST_ROOM, dtype=np.int64)
        self._log_odds = np.zeros(FIRST_ROOM)
        self._landmarks = 0
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
        usable = self._usable(features)
        rows = _rows(features, usable, at_rest)
        places = self._candidates()
        chosen = self._associate(rows, features.identities[usable], hints[usable], places)
        matched = np.flatnonzero(chosen >= 0)
        self._update(places[chosen[matched]], rows[matched])
        verdicts = np.full(len(features), int(MatchVerdict.OUT_OF_RANGE), dtype=np.int64)
        verdicts[usable] = np.where(chosen >= 0, 0, chosen)
        verdicts[usable[matched]] = self._identities[(places[chosen[matched]] - 3) // 2]
        self._existence(places, chosen[matched], sight)
        self._create(rows, usable, chosen, features.identities, hints)
        self.scans += 1
        return verdicts

    def landmarks(self) -> LandmarkMap:
        """All landmarks of the map."""
        count = self._landmarks
        places = 3 + 2 * np.arange(count)
        covariances = np.empty((count, 2, 2))
        for row in range(2):
            for column in range(2):
                covariances[:, row, column] = self._covariance[places + row, places + column]
        return LandmarkMap(
            self._identities[:count].copy(),
            self._mean[3 : 3 + 2 * count].reshape(count, 2).copy(),
            covariances,
            self._log_odds[:count].copy(),
        )

    def state_bytes(self) -> bytes:
        """What the next step depends on, for a hash: every change of the state shows in it."""
        n = self._size
        return self._mean[:n].tobytes() + self._covariance[:3, :n].tobytes() + self._log_odds[: self._landmarks].tobytes()

    @property
    def _size(self) -> int:
        return 3 + 2 * self._landmarks

    def _predict(self, mean: FloatArray, covariance: FloatArray) -> None:
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
            self.refused += 1
            return
        predict(
            self._mean,
            self._covariance,
            self._size,
            mean,
            covariance,
            float(self._jump[0]),
            float(self._jump[1]),
        )

    def _usable(self, features: Features) -> IntArray:
        c = features.covariances
        with np.errstate(invalid="ignore"):
            determinants = c[:, 0, 0] * c[:, 1, 1] - c[:, 0, 1] * c[:, 1, 0]
            sane = np.isfinite(features.ranges_m) & np.isfinite(features.bearings_rad) & np.isfinite(c).all(axis=(1, 2))
            sane &= (c[:, 0, 0] > 0.0) & (determinants > 0.0) & (features.ranges_m > 0.0)
            usable = sane & (features.ranges_m <= self._tuning.range_max_m)
        self.refused += int((~sane).sum())
        return np.flatnonzero(usable)[:IDENTITIES_PER_SCAN]

    def _candidates(self) -> IntArray:
        """Places of landmarks that can be in view."""
        points = self._mean[3 : self._size].reshape(-1, 2)
        gaps = points - self.map_from_body.transform(self._mount[np.newaxis, :2])
        reach = self._tuning.range_max_m + self._tuning.range_margin_m
        return 3 + 2 * np.flatnonzero((gaps**2).sum(axis=1) <= reach * reach)

    def _nearest(self, places: IntArray) -> FloatArray:
        points = self._mean[3 : self._size].reshape(-1, 2)
        numbers = (places - 3) // 2
        squares = ((points[numbers, np.newaxis] - points[np.newaxis]) ** 2).sum(axis=2)
        squares[np.arange(len(numbers)), numbers] = math.inf
        return np.asarray(np.sqrt(squares.min(axis=1, initial=math.inf)))

    def _associate(self, rows: FloatArray, identities: IntArray, hints: IntArray, places: IntArray) -> IntArray:
        settings = self._settings
        gates = Gates(
            settings.match_base_square, settings.match_per_metre_square, settings.match_widest_square, settings.create_square
        )
        chosen = np.full(len(rows), PENDING, dtype=np.int64)
        order = np.argsort(rows[:, 0], kind="stable")
        mean, covariance = block(self._mean, self._covariance, places)
        told = identities if (identities >= 0).any() else hints if settings.association == "particles" else None
        if told is None:
            associate(mean, covariance, self._mount, self._nearest(places), rows, order, gates, chosen)
            return chosen
        gate = settings.match_known_square if told is identities else settings.match_widest_square
        theirs = self._identities[(places - 3) // 2]
        follow(mean, covariance, self._mount, theirs, rows, order, told, gate, chosen)
        return chosen

    def _update(self, places: IntArray, rows: FloatArray) -> None:
        if len(places) == 0:
            self._jump[:] = 0.0
            return
        before = self._mean[:2].copy()
        if self._first:
            self._linearised_at[:3] = self._mean[:3]
        linearised_at = self._linearised_at if self._first else self._mean.copy()
        update(self._mean, self._covariance, linearised_at, self._size, self._mount, places, rows, self._invariant)
        self._jump = self._mean[:2] - before if self._first else np.zeros(2)

    def _existence(self, places: IntArray, matched: IntArray, sight: FloatArray) -> None:
        tuning = self._tuning
        seen = np.zeros(len(places), dtype=np.bool_)
        seen[matched] = True
        sensor = self.map_from_body @ Pose2(*(float(value) for value in self._mount))
        pose = (sensor.x_m, sensor.y_m, sensor.heading_rad)
        gone = []
        for index, place in enumerate(places):
            number = (int(place) - 3) // 2
            if seen[index]:
                self._log_odds[number] = min(self._log_odds[number] + tuning.log_odds_seen, tuning.log_odds_max)
            elif tuning.existence and in_clear_view(self._mean[place], self._mean[place + 1], pose, sight, tuning):
                self._log_odds[number] -= tuning.log_odds_missed
                if self._log_odds[number] < tuning.log_odds_remove:
                    gone.append(number)
        for number in sorted(gone, reverse=True):
            self._forget(number)

    def _forget(self, number: int) -> None:
        forget(self._mean, self._covariance, self._size, 3 + 2 * number)
        last = self._landmarks - 1
        self._linearised_at[3 + 2 * number : 5 + 2 * number] = self._linearised_at[3 + 2 * last : 5 + 2 * last]
        self._identities[number], self._log_odds[number] = self._identities[last], self._log_odds[last]
        self._landmarks = last

    def _create(
        self, rows: FloatArray, usable: IntArray, chosen: IntArray, identities: IntArray, hints: IntArray
    ) -> None:
        for index in np.flatnonzero(chosen == int(MatchVerdict.NEW)):
            self._make_room()
            n = self._size
            append(self._mean, self._covariance, n, self._mount, rows[index])
            self._linearised_at[n : n + 2] = self._mean[n : n + 2]
            known = int(identities[usable[index]])
            if known < 0 and self._settings.association == "particles":
                known = int(hints[usable[index]])
            fresh = self.scans * IDENTITIES_PER_SCAN + int(usable[index])
            self._identities[self._landmarks] = known if known >= 0 else fresh
            self._log_odds[self._landmarks] = self._tuning.log_odds_new
            self._landmarks += 1

    def _make_room(self) -> None:
        room = len(self._identities)
        if self._landmarks < room:
            return
        self._mean = np.concatenate((self._mean, np.zeros(2 * room)))
        self._linearised_at = np.concatenate((self._linearised_at, np.zeros(2 * room)))
        self._identities = np.concatenate((self._identities, np.zeros(room, dtype=np.int64)))
        self._log_odds = np.concatenate((self._log_odds, np.zeros(room)))
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
