"""One scan in all particles: predict, associate, sample, weight, update, existence; compiled as one loop."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray, IntArray
from slam.angles import wrapped
from slam.arithmetic.functions import cosine_sine
from slam.compiled import kernel, leaf
from slam.observations import NEW, FeatureRows
from slam.particles.association import KNOWN, associate, candidates_of
from slam.particles.gather import gather, write_back
from slam.particles.landmark_filter import new_landmark, update_landmark
from slam.particles.pages import (
    FIELDS,
    FREE_PAGES,
    LOG_ODDS,
    NONE,
    USED_SLOTS,
    Pages,
    X,
    Y,
    append,
    remove_below,
    slots_near,
)
from slam.particles.proposals import PoseBelief
from slam.settings.tuning import Proposal, Tuning
from slam.unscented import square_root_into
from slam.visibility import SightLine, in_clear_view, sensor_pose, sighting_of

ShortArray = NDArray[np.int32]

MOTION, UNSCENTED = int(Proposal.MOTION), int(Proposal.UNSCENTED)
LIKELIHOODS, CREATED, REMOVED, MATCHED, SHARED_NEEDED = 0, 1, 2, 3, 4
TALLIES = 5


class ScanInput(NamedTuple):
    """One scan as every particle is told of it.

    increment (3,) and increment_covariance (3, 3) since the last scan; normals (M, 3) to sample with; mount (3,) of the
    sensor on the body; new_identities (K,): names of the landmarks that these features may create.
    """

    increment: FloatArray
    increment_covariance: FloatArray
    normals: FloatArray
    mount: FloatArray
    features: FeatureRows
    new_identities: IntArray
    sight: SightLine


class StepResult(NamedTuple):
    """What a step fills in: log_weights (M,) are added to; matches (M, K) identity or verdict; tallies (5,)."""

    log_weights: FloatArray
    matches: IntArray
    tallies: IntArray


@leaf
def predict(pose: FloatArray, covariance: FloatArray, increment: FloatArray, increment_covariance: FloatArray) -> None:
    """Move an exactly known pose (3,) by the increment (3,) in place; covariance (3, 3) becomes the increment's,
    turned.
    """
    cosine, sine = cosine_sine(pose[2])
    pose[0] += cosine * increment[0] - sine * increment[1]
    pose[1] += sine * increment[0] + cosine * increment[1]
    pose[2] = wrapped(pose[2] + increment[2])
    c = increment_covariance
    covariance[0, 0] = cosine * cosine * c[0, 0] - 2.0 * cosine * sine * c[0, 1] + sine * sine * c[1, 1]
    covariance[1, 1] = sine * sine * c[0, 0] + 2.0 * cosine * sine * c[0, 1] + cosine * cosine * c[1, 1]
    covariance[0, 1] = cosine * sine * (c[0, 0] - c[1, 1]) + (cosine * cosine - sine * sine) * c[0, 1]
    covariance[0, 2] = cosine * c[0, 2] - sine * c[1, 2]
    covariance[1, 2] = sine * c[0, 2] + cosine * c[1, 2]
    covariance[2, 2] = c[2, 2]
    covariance[1, 0], covariance[2, 0], covariance[2, 1] = covariance[0, 1], covariance[0, 2], covariance[1, 2]


@leaf
def sample(belief: PoseBelief, normals: FloatArray) -> None:
    """Draw the pose from N(pose, covariance) in place with three standard normal numbers; the root is overwritten."""
    pose, root = belief.pose, belief.root
    square_root_into(belief.covariance, root)
    for row in range(3):
        for column in range(row + 1):
            pose[row] += root[row, column] * normals[column]
    pose[2] = wrapped(pose[2])


@kernel
def landmarks_near(
    pages: Pages, particle: int, cell_m: float, x: float, y: float, radius_m: float
) -> tuple[FloatArray, IntArray]:
    """One particle's landmarks in the cells around a point: numbers (C, 6) and identities (C,)."""
    slots = np.empty(max(pages.tally[USED_SLOTS], 1), dtype=np.int32)
    found = slots_near(pages, cell_m, x, y, radius_m, slots)
    numbers, identities, _, _ = gather(pages, particle, slots, found, x, y, radius_m)
    return numbers, identities


@leaf
def update_matches(
    candidates: FloatArray,
    sensor: tuple[float, float, float],
    features: FeatureRows,
    chosen: IntArray,
    tuning: Tuning,
    changed: NDArray[np.bool_],
) -> int:
    """Fold every matched feature into its landmark and raise that one's log-odds; returns how many matched."""
    matched, linear = 0, tuning.proposal != UNSCENTED
    for position in range(features.order.size):
        feature = features.order[position]
        landmark = chosen[feature]
        if landmark >= 0:
            sighting = sighting_of(features, feature)
            update_landmark(candidates[landmark], sensor, sighting, tuning.single_weights, tuning.spread, linear)
            log_odds = candidates[landmark, LOG_ODDS] + tuning.log_odds_seen
            candidates[landmark, LOG_ODDS] = min(log_odds, tuning.log_odds_max)
            changed[landmark] = True
            matched += 1
    return matched


@leaf
def lower_missed(
    candidates: FloatArray,
    sensor: tuple[float, float, float],
    sight: SightLine,
    tuning: Tuning,
    changed: NDArray[np.bool_],
) -> bool:
    """Lower the log-odds of landmarks that should have been seen and were not; True if any landmark is to go."""
    doomed = False
    for index in range(candidates.shape[0]):
        if not changed[index] and in_clear_view(candidates[index, X], candidates[index, Y], sensor, sight, tuning):
            candidates[index, LOG_ODDS] -= sight.certainty * tuning.log_odds_missed
            changed[index] = True
        doomed = doomed or candidates[index, LOG_ODDS] < tuning.log_odds_remove
    return doomed


@leaf
def create_landmarks(
    pages: Pages,
    particle: int,
    sensor: tuple[float, float, float],
    scan: ScanInput,
    chosen: IntArray,
    tuning: Tuning,
    fresh: FloatArray,
) -> int:
    """A landmark of every feature that is NEW; fresh (6,) is overwritten. Returns how many."""
    created, linear = 0, tuning.proposal != UNSCENTED
    for feature in range(chosen.size):
        if chosen[feature] == NEW:
            sighting = sighting_of(scan.features, feature)
            new_landmark(fresh, sensor, sighting, tuning.single_weights, tuning.spread, linear)
            fresh[LOG_ODDS] = tuning.log_odds_new
            append(pages, particle, tuning.cell_m, fresh, scan.new_identities[feature])
            created += 1
    return created


@leaf
def prune(pages: Pages, particle: int, slots: ShortArray, slot_count: int, log_odds: float) -> int:
    """Remove this particle's landmarks in the slots whose log-odds are below the bound; returns how many."""
    removed = 0
    for index in range(slot_count):
        if pages.table[particle, slots[index]] != NONE:
            removed += remove_below(pages, particle, slots[index], log_odds)
    return removed


@kernel
def step_particles(
    pages: Pages, poses: FloatArray, first: int, scan: ScanInput, tuning: Tuning, result: StepResult
) -> int:
    """Step particles first .. M-1, poses (M, 3), by one scan; everything is changed in place.

    Returns M, or the particle that found too little free room in `pages`: enlarge them by
    tallies[SHARED_NEEDED] and go on there.
    """
    features, mount, tallies = scan.features, scan.mount, result.tallies
    count = features.ranges_m.size
    slots = np.empty(max(pages.tally[USED_SLOTS], 1), dtype=np.int32)
    chosen = np.empty(count, dtype=np.int64)
    fresh = np.empty(FIELDS)
    radius = -1.0
    if tuning.range_gate and tuning.strategy != KNOWN:
        radius = tuning.range_max_m + tuning.range_margin_m
    for particle in range(first, poses.shape[0]):
        if pages.tally[USED_SLOTS] > slots.size:
            slots = np.empty(pages.tally[USED_SLOTS], dtype=np.int32)
        belief = PoseBelief(poses[particle].copy(), np.empty((3, 3)), np.empty((3, 3)))
        predict(belief.pose, belief.covariance, scan.increment, scan.increment_covariance)
        if tuning.proposal == MOTION:
            sample(belief, scan.normals[particle])
            belief.covariance[:] = 0.0

        sensor = sensor_pose(belief.pose, mount)
        slot_count = slots_near(pages, tuning.cell_m, sensor[0], sensor[1], radius, slots)
        landmarks, identities, places, shared = gather(pages, particle, slots, slot_count, sensor[0], sensor[1], radius)
        if pages.tally[FREE_PAGES] < shared + count or pages.overflow.size - pages.tally[USED_SLOTS] < count:
            tallies[SHARED_NEEDED] = shared
            return particle
        candidates = candidates_of(landmarks, identities)
        log_weight, evaluated = associate(belief, mount, candidates, features, tuning, chosen)
        result.log_weights[particle] += log_weight
        tallies[LIKELIHOODS] += evaluated

        if tuning.proposal != MOTION:
            sample(belief, scan.normals[particle])
        poses[particle] = belief.pose
        sensor = sensor_pose(belief.pose, mount)

        changed = np.zeros(landmarks.shape[0], dtype=np.bool_)
        tallies[MATCHED] += update_matches(landmarks, sensor, features, chosen, tuning, changed)
        for feature in range(count):
            landmark = chosen[feature]
            result.matches[particle, feature] = identities[landmark] if landmark >= 0 else landmark
        doomed = tuning.existence and lower_missed(landmarks, sensor, scan.sight, tuning, changed)
        write_back(pages, particle, landmarks, places, changed)
        if doomed:
            tallies[REMOVED] += prune(pages, particle, slots, slot_count, tuning.log_odds_remove)
        tallies[CREATED] += create_landmarks(pages, particle, sensor, scan, chosen, tuning, fresh)
    return len(poses)
