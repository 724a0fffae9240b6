"""One scan in all particles: predict, associate, sample, weight, update, existence; compiled as one loop.

Features come as rows (K, 8): range m, bearing rad, covariance rr, rb, bb, 1 where a new landmark is licensed, and the
unit vector towards the feature in the body's axes. The sight line is the scan itself, (3 + N,): first bearing, bearing
step, range of no return, then N ranges; N = 0 where there is no scan.
"""

import math

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray, IntArray
from slam.angles import wrapped
from slam.compiled import kernel, leaf
from slam.particles.association import (
    NEW,
    associate_by_identity,
    associate_sequentially,
    associate_simultaneously,
    fold_all,
)
from slam.particles.gates import sighting_of
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
from slam.settings.tuning import Proposal, Strategy, Tuning
from slam.unscented import square_root_into
from slam.visibility import in_clear_view, sensor_pose

ShortArray = NDArray[np.int32]

MOTION, UNSCENTED = int(Proposal.MOTION), int(Proposal.UNSCENTED)
SEQUENTIAL, KNOWN = int(Strategy.SEQUENTIAL), int(Strategy.KNOWN)
LIKELIHOODS, CREATED, REMOVED, MATCHED, SHARED_NEEDED = 0, 1, 2, 3, 4
TALLIES = 5


@leaf
def predict(pose: FloatArray, covariance: FloatArray, increment: FloatArray, increment_covariance: FloatArray) -> None:
    """Move an exactly known pose (3,) by the increment (3,) in place; covariance (3, 3) becomes the increment's,
    turned.
    """
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
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


@kernel
def sample(pose: FloatArray, covariance: FloatArray, normals: FloatArray) -> None:
    """Draw from N(pose, covariance) in place with three standard normal numbers."""
    root = np.empty((3, 3))
    square_root_into(covariance, root)
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
    features: FloatArray,
    order: IntArray,
    chosen: IntArray,
    linear: bool,
    tuning: Tuning,
    changed: NDArray[np.bool_],
) -> int:
    """Fold every matched feature into its landmark and raise that one's log-odds; returns how many matched."""
    matched = 0
    for position in range(order.size):
        feature = order[position]
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
    sight: FloatArray,
    tuning: Tuning,
    changed: NDArray[np.bool_],
) -> bool:
    """Lower the log-odds of landmarks that should have been seen and were not; True if any landmark is to go."""
    doomed = False
    for index in range(candidates.shape[0]):
        if not changed[index] and in_clear_view(candidates[index, X], candidates[index, Y], sensor, sight, tuning):
            candidates[index, LOG_ODDS] -= tuning.log_odds_missed
            changed[index] = True
        doomed = doomed or candidates[index, LOG_ODDS] < tuning.log_odds_remove
    return doomed


@kernel
def step_particles(
    pages: Pages,
    poses: FloatArray,
    log_weights: FloatArray,
    first: int,
    increment: FloatArray,
    increment_covariance: FloatArray,
    normals: FloatArray,
    mount: FloatArray,
    features: FloatArray,
    feature_identities: IntArray,
    order: IntArray,
    sight: FloatArray,
    tuning: Tuning,
    new_identities: IntArray,
    matches: IntArray,
    tallies: IntArray,
) -> int:
    """Step particles first .. M-1 by one scan; everything is changed in place.

    poses (M, 3), log_weights (M,), normals (M, 3), mount (3,), matches (M, K) landmark identity or verdict, tallies
    (5,). order (K,): features by range, nearest first. new_identities (K,): names of landmarks that these features
    may create. Returns M, or the particle that found too little free room in `pages`: enlarge them by tallies[4] and
    go on there.
    """
    count = features.shape[0]
    slots = np.empty(max(pages.tally[USED_SLOTS], 1), dtype=np.int32)
    chosen = np.empty(count, dtype=np.int64)
    covariance = np.empty((3, 3))
    fresh = np.empty(FIELDS)
    linear = tuning.proposal != UNSCENTED
    for particle in range(first, poses.shape[0]):
        if pages.tally[USED_SLOTS] > slots.size:
            slots = np.empty(pages.tally[USED_SLOTS], dtype=np.int32)
        pose = poses[particle].copy()
        predict(pose, covariance, increment, increment_covariance)
        if tuning.proposal == MOTION:
            sample(pose, covariance, normals[particle])
            covariance[:] = 0.0
        sensor = sensor_pose(pose, mount)
        radius = -1.0
        if tuning.range_gate and tuning.strategy != KNOWN:
            radius = tuning.range_max_m + tuning.range_margin_m
        slot_count = slots_near(pages, tuning.cell_m, sensor[0], sensor[1], radius, slots)
        candidates, identities, places, shared = gather(
            pages, particle, slots, slot_count, sensor[0], sensor[1], radius
        )
        if pages.tally[FREE_PAGES] < shared + count or pages.overflow.size - pages.tally[USED_SLOTS] < count:
            tallies[SHARED_NEEDED] = shared
            return particle

        if tuning.strategy == SEQUENTIAL:
            log_weight, evaluated = associate_sequentially(
                pose, covariance, mount, candidates, features, order, tuning, chosen
            )
        else:
            if tuning.strategy == KNOWN:
                evaluated = associate_by_identity(
                    pose, covariance, mount, candidates, identities, features, feature_identities, tuning, chosen
                )
            else:
                evaluated = associate_simultaneously(pose, covariance, mount, candidates, features, tuning, chosen)
            log_weight = fold_all(pose, covariance, mount, candidates, features, order, tuning, chosen)
        log_weights[particle] += log_weight
        tallies[LIKELIHOODS] += evaluated

        if tuning.proposal != MOTION:
            sample(pose, covariance, normals[particle])
        poses[particle] = pose
        sensor = sensor_pose(pose, mount)

        changed = np.zeros(candidates.shape[0], dtype=np.bool_)
        tallies[MATCHED] += update_matches(candidates, sensor, features, order, chosen, linear, tuning, changed)
        for feature in range(count):
            landmark = chosen[feature]
            matches[particle, feature] = identities[landmark] if landmark >= 0 else landmark
        doomed = tuning.existence and lower_missed(candidates, sensor, sight, tuning, changed)
        write_back(pages, particle, candidates, places, changed)
        if doomed:
            for index in range(slot_count):
                if pages.table[particle, slots[index]] != NONE:
                    tallies[REMOVED] += remove_below(pages, particle, slots[index], tuning.log_odds_remove)
        for feature in range(count):
            if chosen[feature] == NEW:
                new_landmark(
                    fresh, sensor, sighting_of(features, feature), tuning.single_weights, tuning.spread, linear
                )
                fresh[LOG_ODDS] = tuning.log_odds_new
                append(pages, particle, tuning.cell_m, fresh, new_identities[feature])
                tallies[CREATED] += 1
    return len(poses)
