"""One Gaussian over the pose and the landmarks, beside the particles: the published pose and a covariance that can be
trusted.

The particles' own covariance is hundreds of times too small, because resampling wipes out history.
"""

import math
from typing import Literal, NamedTuple

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.arithmetic.small_matrices import bounded_below
from slam.estimate import LandmarkMap
from slam.joint.association import associate_by_hint, gates_of, off_squares
from slam.joint.atlas import AWAY
from slam.joint.evidence import (
    CONFIDENT,
    FIRST_FINDS_AFTER_MISS,
    FIRST_LOOKS_AFTER_MISS,
    SETTLED_SCANS,
    Confidence,
    DetectionRates,
    Evidence,
    InView,
    score,
)
from slam.joint.kernels import predict, update
from slam.joint.keyframe_axis import AHEAD, BEHIND, between_with_covariance, condition, seen_from
from slam.joint.measurement import FIRST_PLACE, JointArrays
from slam.joint.neighbours import block, places_within, standing_double, update_existence
from slam.joint.slip import associate_with_slip, undecided
from slam.joint.state import MOST_IN_STATE, JointState
from slam.observations import IDENTITIES_PER_SCAN, NEW, PENDING, FeatureRows, as_repeated
from slam.pose import Pose2
from slam.settings.joint import JointSettings
from slam.settings.tuning import Tuning
from slam.visibility import NO_SIGHT, SightLine, sensor_pose, sighting_of

LOOK_STEP_M = 0.1  # a radian counted as a metre: a look from nearer than this is the same look again
CONFIRMED_LOG_ODDS = 3.0  # a landmark that leaves the view below this is forgotten: a chance point
SMALLEST_VARIANCE = 1e-12  # m^2 and rad^2: keeps the published covariance positive where the map frame is defined
KEYFRAME = -1  # identity of an end of a keyframe's axis
SHIFTED_M = 1.0  # a jump of the pose after which far landmarks are sorted into cells anew


class Variant(NamedTuple):
    """What the filter could do otherwise; the defaults are decisions 0010 and 0011, tests show what the others cost.

    association: who decides which feature is which landmark; the best particle's slips would be inherited.
    creation: which features may start a landmark; "any" lets walking people drag the pose.
    jacobians: where derivatives are taken; "current" alone grows overconfident in heading.
    """

    association: Literal["own", "particles"] = "own"
    creation: Literal["any", "licensed"] = "licensed"
    jacobians: Literal["invariant", "first_estimates", "current"] = "invariant"


DECIDED = Variant()


class JointGaussian:
    """Extended Kalman filter over pose and landmarks with the paper's landmark management; its state is public."""

    def __init__(
        self, settings: JointSettings, body_from_laser: Pose2, tuning: Tuning, variant: Variant = DECIDED
    ) -> None:
        self._variant = variant
        self._mount, self._tuning = body_from_laser.as_array(), tuning
        self._invariant, self._first = (variant.jacobians == kind for kind in ("invariant", "first_estimates"))
        self._reach_m = self._tuning.range_max_m + self._tuning.range_margin_m
        self.state = JointState(settings, self._reach_m, self._tuning.cell_m)
        self._jump = np.zeros(2)
        self._since_look_m = self._way_m = 0.0
        self.after_miss = np.array((FIRST_LOOKS_AFTER_MISS, FIRST_FINDS_AFTER_MISS))
        self.keyframe_ends = np.zeros((0, 2), dtype=np.int64)
        self.scans = self.moves = self.refused = 0
        self.evidence = Evidence()

    @property
    def map_from_body(self) -> Pose2:
        """The pose at the last scan."""
        return Pose2(*(float(value) for value in self.state.mean[:3]))

    @property
    def covariance(self) -> FloatArray:
        """(3, 3) over x, y, heading in the map frame: symmetric and positive definite."""
        return bounded_below(self.state.covariance[:3, :3], SMALLEST_VARIANCE)

    @property
    def landmark_count(self) -> int:
        """Landmarks in the map."""
        return self.state.atlas.count - self.keyframe_ends.size

    @property
    def landmarks_in_state(self) -> int:
        """Landmarks in the joint state: what a step costs depends on these."""
        return self.state.count

    def add_keyframe(self) -> None:
        """The pose of now becomes a keyframe: it stays in the state, or hangs on what does, as landmarks do."""
        ends = [self.state.create_end(KEYFRAME, np.zeros(3), end) for end in (AHEAD, BEHIND)]
        self.keyframe_ends = np.vstack((self.keyframe_ends, ends))

    def forget_keyframes(self, number: int) -> None:
        """Those from this number on, as far as the state has them."""
        self.state.take_out(self.state.atlas.holding(KEYFRAME, self.keyframe_ends[number:].ravel()))
        self.keyframe_ends = self.keyframe_ends[:number]

    def from_keyframes(self) -> FloatArray:
        """(K, 3) the body as seen from every keyframe; inf where one is outside the state."""
        return seen_from(self.state.mean, self.state.atlas.place[self.keyframe_ends])

    def from_keyframe(self, number: int) -> tuple[FloatArray, FloatArray]:
        """The body (3,) as seen from one keyframe of the state, and its covariance (3, 3)."""
        state = self.state
        ahead, behind = state.atlas.place[self.keyframe_ends[number]].tolist()
        seen, spread, _ = between_with_covariance(state.mean, state.covariance, state.size, ahead, behind)
        return seen, spread

    def condition(self, number: int, off: FloatArray, posterior: FloatArray) -> None:
        """A scan laid onto a keyframe says: the body is off (3,) from where it was thought to be, as seen from there.

        posterior (3, 3): how well that is known now, this filter's own knowledge included.
        """
        state = self.state
        before = state.mean[:2].copy()
        ends = state.atlas.place[self.keyframe_ends[number]]
        with state.frozen_kept():
            condition(state.mean, state.covariance, state.size, ends, off, posterior, self._invariant)
        if math.dist(state.mean[:2], before) > SHIFTED_M:
            state.sort_anew()

    def step(
        self,
        increment_mean: FloatArray,
        increment_covariance: FloatArray,
        features: FeatureRows,
        hints: IntArray,
        sight: SightLine = NO_SIGHT,
        confidence: Confidence = CONFIDENT,
    ) -> IntArray:
        """One scan: `predict` and `observe`."""
        self.predict(increment_mean, increment_covariance)
        stands = not (increment_covariance.any() or increment_mean.any())
        return self.observe(features, hints, sight, confidence, begins=stands)

    def predict(self, mean: FloatArray, covariance: FloatArray) -> None:
        """Move the pose by an increment (3,) and (3, 3) since the last scan in the body frame of then."""
        self.moves += 1
        state, jump = self.state, self._jump
        if np.isfinite(mean).all() and np.isfinite(covariance).all():
            way_m = math.hypot(mean[0], mean[1]) + abs(mean[2])
            self._since_look_m, self._way_m = self._since_look_m + way_m, self._way_m + way_m
            predict(state.mean, state.covariance, state.size, mean, covariance, float(jump[0]), float(jump[1]))
        else:
            self.refused += 1
        state.bring_back()

    def observe(
        self,
        features: FeatureRows,
        hints: IntArray,
        sight: SightLine = NO_SIGHT,
        confidence: Confidence = CONFIDENT,
        *,
        alone_m: float = math.inf,
        begins: bool = False,
    ) -> IntArray:
        """What the scan at the predicted pose shows; where a map begins everything may create a landmark.

        hints (K,): identities or verdicts of the best particle, for a variant. sight: how far the scan looked.
        confidence: what earlier scans said of the pose; while it is lost, nothing is written into the map.
        alone_m: landmarks whose place is known worse move the pose together or not at all. Returns this filter's own
        identities or verdicts (K,).
        """
        state = self.state
        features = features._replace(may_create=features.may_create | (begins or self._variant.creation == "any"))
        sensor = sensor_pose(state.mean, self._mount)
        places = places_within(state.mean, state.size, sensor[0], sensor[1], self._reach_m)
        if len(self.keyframe_ends):
            places = places[state.atlas.identities[state.rows_at(places)] != KEYFRAME]
        chosen = self._associate(features, hints, places, alone_m)
        settled = self._settled(places, confidence.settled_before)
        unsure = undecided(self._arrays, places, alone_m, features, gates_of(self._tuning))
        near, atlas = state.rows_at(places), state.atlas
        from_elsewhere = self._since_look_m >= LOOK_STEP_M
        if from_elsewhere:
            self._since_look_m = 0.0
        looked = (atlas.looks[near], atlas.finds[near], atlas.missed[near], self.after_miss.copy())
        rates, in_view, tuning = DetectionRates(*looked, from_elsewhere), InView(places, settled, unsure), self._tuning
        self.evidence = score(self._arrays, in_view, features, chosen, sight, rates, tuning)
        matched = np.flatnonzero(chosen >= 0)
        found, way_m, self._way_m = places[chosen[matched]], self._way_m, 0.0
        off = off_squares(self._arrays, found, matched, features)
        self._update(found, matched, as_repeated(features, matched, off, way_m, tuning.lasting))
        verdicts = chosen.copy()
        verdicts[matched] = atlas.identities[near[chosen[matched]]]
        if not confidence.lost:
            atlas.looks[near], atlas.finds[near], atlas.missed[near], self.after_miss = looked
            self._existence(places, chosen[matched], sight, told_apart=bool((features.identities >= 0).any()))
            self._create(features, chosen, hints)
        state.put_away()
        self.scans += 1
        return verdicts

    def landmarks(self) -> LandmarkMap:
        """All landmarks of the map; covariances of those far away are as they were when last near."""
        state, atlas = self.state, self.state.atlas
        means, covariances = state.settled_means(), state.settled_covariances()
        used = np.flatnonzero((atlas.place >= AWAY) & (atlas.identities != KEYFRAME))
        return LandmarkMap(atlas.identities[used], means[used], covariances[used], atlas.log_odds[used])

    def state_bytes(self) -> bytes:
        """What the next step depends on, for a hash: every change of the state shows in it."""
        state = self.state
        atlas, rows = state.atlas, state.rows
        learnt = (atlas.log_odds[rows], atlas.looks[rows], atlas.finds[rows], atlas.missed[rows], self.after_miss)
        parts = (state.mean[: state.size], state.covariance[:3, : state.size], *learnt, np.array(self._since_look_m))
        return b"".join(part.tobytes() for part in parts)

    @property
    def _arrays(self) -> JointArrays:
        """The state as compiled code takes it."""
        return JointArrays(self.state.mean, self.state.covariance, self.state.size, self._mount)

    def _associate(self, features: FeatureRows, hints: IntArray, places: IntArray, alone_m: float) -> IntArray:
        """(K,) numbers of landmarks among places (k,), or verdicts."""
        tuning, state = self._tuning, self.state
        reported = bool((features.identities >= 0).any())
        if not reported and self._variant.association == "own":
            old, everywhere = self._settled(places, self.scans - SETTLED_SCANS), self._landmark_places()
            gates = gates_of(tuning)
            return associate_with_slip(self._arrays, places, everywhere, old, alone_m, features, gates)
        mean, covariance = block(state.mean, state.covariance, places)
        gate = tuning.match_known_square if reported else gates_of(tuning).match_widest
        hints = features.identities if reported else hints
        known = state.atlas.identities[state.rows_at(places)]
        chosen = np.full(len(hints), PENDING, dtype=np.int64)
        associate_by_hint(mean, covariance, self._mount, known, features, hints, gate, chosen)
        return chosen

    def _landmark_places(self) -> IntArray:
        """(l,) places of all landmarks of the state."""
        state = self.state
        places: IntArray = FIRST_PLACE + 2 * np.arange(state.count)
        return places if not len(self.keyframe_ends) else places[state.atlas.identities[state.rows] != KEYFRAME]

    def _settled(self, places: IntArray, before: int) -> BoolArray:
        """(k,) which landmarks were made before this scan's number and are likelier real than not."""
        near, atlas = self.state.rows_at(places), self.state.atlas
        settled: BoolArray = (atlas.identities[near] < before * IDENTITIES_PER_SCAN) & (atlas.log_odds[near] >= 0.0)
        return settled

    def _update(self, places: IntArray, matched: IntArray, features: FeatureRows) -> None:
        """Fold the matched (k,) features into the landmarks at places (k,) and the pose, all at once."""
        state, before = self.state, self.state.mean[:2].copy()
        if len(places) == 0:
            self._jump[:] = 0.0
            return
        linearised_at = state.linearised_at if self._first else state.mean.copy()
        linearised_at[:3] = state.mean[:3]
        with state.frozen_kept():
            update(self._arrays, linearised_at, places, matched, features, self._invariant)
        jump = state.mean[:2] - before
        self._jump = jump if self._first else np.zeros(2)
        if math.hypot(float(jump[0]), float(jump[1])) > SHIFTED_M:
            state.sort_anew()

    def _existence(self, places: IntArray, matched: IntArray, sight: SightLine, *, told_apart: bool) -> None:
        """Existence log-odds (6); removes what was missed too often, what leaves the view unconfirmed, and the younger
        of two landmarks in one place, unless they are told apart by what they report.
        """
        tuning, state, atlas = self._tuning, self.state, self.state.atlas
        seen = np.zeros(len(places), dtype=np.bool_)
        seen[matched] = True
        near = state.rows_at(places)
        log_odds = atlas.log_odds[near]
        update_existence(self._arrays, places, seen, log_odds, sight, tuning)
        atlas.log_odds[near] = np.maximum(log_odds, -tuning.log_odds_max)
        if not tuning.existence:
            return
        bound = np.full(state.count, CONFIRMED_LOG_ODDS)
        bound[(places - FIRST_PLACE) // 2] = tuning.log_odds_remove
        if not told_apart:
            double = standing_double(state.mean, places, atlas.identities[near])
            bound[(places[double] - FIRST_PLACE) // 2] = math.inf
        bound[atlas.frozen[state.rows]] = -math.inf
        for number in np.flatnonzero(atlas.log_odds[state.rows] < bound)[::-1].tolist():
            state.remove(number)

    def _create(self, features: FeatureRows, chosen: IntArray, hints: IntArray) -> None:
        room = max(0, MOST_IN_STATE - self.state.count)
        for index in np.flatnonzero(chosen == NEW).tolist()[:room]:
            known = int(features.identities[index])
            if known < 0 and self._variant.association == "particles":
                known = int(hints[index])
            identity = known if known >= 0 else self.scans * IDENTITIES_PER_SCAN + int(features.numbers[index])
            self.state.create(identity, self._tuning.log_odds_new, self._mount, sighting_of(features, index))
