"""Two maps become one: what stands around the rover is joined to a map in which its place was recognised.

The pose takes the part of the transform, so that it shares the errors of the landmarks it is known by. It is not set to
what was recognised with a covariance of its own: the next scans would move the map.
"""

import math
from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.arithmetic.functions import lengths
from slam.arithmetic.small_matrices import applied, product
from slam.joint.atlas import AWAY
from slam.joint.gaussian import KEYFRAME, JointGaussian
from slam.joint.measurement import FIRST_PLACE
from slam.joint.state import JointState
from slam.maps.joint_map import tie_pose
from slam.observations import IDENTITIES_PER_SCAN
from slam.pose import Pose2, turning
from slam.recognise.attempt import LocalPoints
from slam.recognise.scale import Scale
from slam.relocalise.joint_compatibility import Conditioned, condition_on_matches

LAID = np.diag((0.1 * 0.1, 0.1 * 0.1, 0.02 * 0.02))  # of a pose that scans say
ANYWHERE = np.diag((1e4, 1e4, 9.0))  # nothing of the old pose is believed
LEAST_MATCHES = 4
FAR_TIMES, FAR_M2 = 4.0, 1.0  # covariance of what is turned along rigidly: its own so many times, and so much more
FAR_MOST_M = (
    3.0  # that a landmark is moved along: trees stand some 5 to 8 m apart, and one that is known worse is any of them
)
NEAR_SIGMAS = 3.0  # of the scale: nearer to a landmark none is added
MATCHED_LOG_ODDS = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class FarLandmarks:
    """Landmarks that go along rigidly: identities (L,), means_m (L, 2), covariances_m2 (L, 2, 2), log_odds (L,)."""

    identities: IntArray
    means_m: FloatArray
    covariances_m2: FloatArray
    log_odds: FloatArray

    def turned(self, new_from_old: Pose2, most_m: float = math.inf) -> "FarLandmarks":
        """The same in another frame, less exact, without those that lie more than most_m from where they lay."""
        means = new_from_old.transform(self.means_m)
        kept = np.flatnonzero(lengths(means - self.means_m) <= most_m)
        turn = turning(new_from_old.heading_rad)
        half = (turn[:, :, None] * self.covariances_m2[kept, None]).sum(axis=2)
        covariances = FAR_TIMES * (half[:, :, None] * turn).sum(axis=3) + FAR_M2 * np.eye(2)
        return FarLandmarks(self.identities[kept], means[kept], covariances, self.log_odds[kept])


def far_landmarks(
    joint: JointGaussian, since_scan: int, without: IntArray, pose: Pose2, nearest_m: float
) -> FarLandmarks:
    """What was made from a scan on, is farther from the pose than nearest_m, and is not among `without`."""
    everything = joint.landmarks()
    distances = lengths(everything.means_m - (pose.x_m, pose.y_m))
    wanted = (everything.identities >= since_scan * IDENTITIES_PER_SCAN) & (distances > nearest_m)
    chosen = np.flatnonzero(wanted & ~np.isin(everything.identities, without))
    return FarLandmarks(
        everything.identities[chosen],
        everything.means_m[chosen],
        everything.covariances_m2[chosen],
        everything.existence_log_odds[chosen],
    )


def rows_since(joint: JointGaussian, scan: int) -> IntArray:
    """Rows (r,) of the landmarks that were made from a scan on."""
    atlas = joint.state.atlas
    made_since = (atlas.place >= AWAY) & (atlas.identities >= scan * IDENTITIES_PER_SCAN)
    rows: IntArray = np.flatnonzero(made_since & (atlas.identities != KEYFRAME))
    return rows


def join(
    joint: JointGaussian,
    points: LocalPoints,
    known: dict[int, int],
    map_from_body: Pose2,
    scale: Scale,
    ghosts: IntArray,
    *,
    by_scans: bool = False,
) -> Conditioned | None:
    """Put the pose where it was recognised and add the local points; None, and nothing changed, where they contradict.

    known: identity in the map by identity of the local point. ghosts: rows of landmarks that are taken out. by_scans:
    the pose is known without them; those that contradict it are not believed.
    """
    state = joint.state
    state.bring_back_around(map_from_body.x_m, map_from_body.y_m)
    if by_scans:
        tie_pose(joint, map_from_body, LAID)
    places = places_of(state)
    matches = [
        (index, places[known[identity]])
        for index, identity in enumerate(points.identities.tolist())
        if known.get(identity) in places
    ]
    n, count = state.size, len(points)
    mean = np.concatenate((state.mean[:n], points.points_m.ravel()))
    mean[:3] = map_from_body.as_array()
    covariance = np.zeros((len(mean), len(mean)))
    covariance[:n, :n] = state.covariance[:n, :n]
    if not by_scans:
        covariance[:3, :n], covariance[:n, :3] = 0.0, 0.0
        covariance[:3, :3] = ANYWHERE
    covariance[n:, n:] = points.covariance_m2

    def gaps(at: FloatArray, kept: list[int]) -> tuple[FloatArray, FloatArray]:
        turn = turning(-float(at[2]))  # body_from_map
        values, slopes = np.zeros(2 * len(kept)), np.zeros((2 * len(kept), len(at)))
        for row, number in enumerate(kept):
            index, place = matches[number]
            two, own = slice(2 * row, 2 * row + 2), slice(n + 2 * index, n + 2 * index + 2)
            seen = applied(turn, at[place : place + 2] - at[:2])
            values[two] = at[own] - seen
            slopes[two, :2], slopes[two, place : place + 2], slopes[two, own] = turn, -turn, np.eye(2)
            slopes[two, 2] = -seen[1], seen[0]
        return values, slopes

    unknown, least = (0, 1) if by_scans else (3, LEAST_MATCHES)
    found = condition_on_matches(mean, covariance, gaps, len(matches), scale.same_sigma_m, unknown, least)
    if found is None and by_scans:
        found, matches = Conditioned(mean, covariance, [], 0.0, 0), []
    if found is None:
        return None
    found.mean[2] = math.remainder(found.mean[2], 2.0 * math.pi)
    with state.frozen_kept():
        state.mean[:n], state.covariance[:n, :n] = found.mean[:n], found.covariance[:n, :n]
    for _, place in (matches[number] for number in found.kept):
        row = state.rows[(place - FIRST_PLACE) // 2]
        state.atlas.log_odds[row] = max(state.atlas.log_odds[row], MATCHED_LOG_ODDS)
    _add_new(joint, points, sorted(set(range(count)) - {index for index, _ in matches}), found, scale, ghosts)
    state.take_out(ghosts)
    state.sort_anew()
    return found


def condition_on_same(joint: JointGaussian, same: dict[int, int], scale: Scale) -> Conditioned | None:
    """A loop within what the drift may be: pairs of landmarks of the state are one; None, and nothing changed, where
    they contradict. The pose and the map follow as far as they hang on it.
    """
    state = joint.state
    state.bring_back_around(state.mean[0], state.mean[1])
    places = places_of(state)
    matches = [(places[new], places[old]) for new, old in same.items() if new in places and old in places]
    n = state.size

    def gaps(at: FloatArray, kept: list[int]) -> tuple[FloatArray, FloatArray]:
        values, slopes = np.zeros(2 * len(kept)), np.zeros((2 * len(kept), n))
        for row, number in enumerate(kept):
            new, old = matches[number]
            two = slice(2 * row, 2 * row + 2)
            values[two] = at[new : new + 2] - at[old : old + 2]
            slopes[two, new : new + 2], slopes[two, old : old + 2] = np.eye(2), -np.eye(2)
        return values, slopes

    prior = state.covariance[:n, :n].copy()
    found = condition_on_matches(state.mean[:n].copy(), prior, gaps, len(matches), scale.same_sigma_m, 0, LEAST_MATCHES)
    if found is None:
        return None
    found.mean[2] = math.remainder(found.mean[2], 2.0 * math.pi)
    with state.frozen_kept():
        state.mean[:n], state.covariance[:n, :n] = found.mean, found.covariance
    doubles = [state.rows[(matches[number][0] - FIRST_PLACE) // 2] for number in found.kept]
    state.take_out(np.array(doubles, dtype=np.int64))
    state.sort_anew()
    return found


def carry_along(joint: JointGaussian, far: FarLandmarks, scale: Scale) -> None:
    """Far landmarks come into the map by themselves: they hang on nothing."""
    known = joint.landmarks()
    taken = set(known.identities.tolist())
    for identity, mean, covariance, log_odds in zip(
        far.identities.tolist(), far.means_m, far.covariances_m2, far.log_odds.tolist(), strict=True
    ):
        if identity in taken or _is_near(mean, known.means_m, math.sqrt(FAR_M2) + NEAR_SIGMAS * scale.sigma_m):
            continue
        joint.state.atlas.add_away(identity, log_odds, mean, covariance)


def places_of(state: JointState) -> dict[int, int]:
    """Place in the state vector by identity."""
    identities = state.atlas.identities[state.rows].tolist()
    return {identity: FIRST_PLACE + 2 * number for number, identity in enumerate(identities) if identity != KEYFRAME}


def _add_new(
    joint: JointGaussian, points: LocalPoints, chosen: list[int], found: Conditioned, scale: Scale, ghosts: IntArray
) -> None:
    """Unmatched local points become landmarks, correlated with all that was conditioned."""
    state, n = joint.state, joint.state.size
    staying = state.atlas.place >= AWAY
    staying[ghosts] = False
    taken = set(state.atlas.identities[staying].tolist())
    x, y, heading = found.mean[:3].tolist()
    turn = turning(heading)  # map_from_body
    known = state.points_m[staying[state.rows]]
    by = np.eye(n, len(found.mean))
    for index in chosen:
        own = slice(n + 2 * index, n + 2 * index + 2)
        away = applied(turn, found.mean[own])
        mean = np.array((x, y)) + away
        if _is_near(mean, known, NEAR_SIGMAS * scale.sigma_m):
            continue
        row = np.zeros((2, len(found.mean)))
        row[:, :2], row[:, 2], row[:, own] = np.eye(2), (-away[1], away[0]), turn
        identity = int(points.identities[index])
        while identity in taken:
            identity += IDENTITIES_PER_SCAN // 2
        taken.add(identity)
        cross = product(row, found.covariance)
        state.append(identity, float(points.log_odds[index]), mean, product(cross, by.T), product(cross, row.T))
        by = np.vstack((by, row))


def _is_near(mean: FloatArray, others: FloatArray, distance_m: float) -> bool:
    return bool((lengths(others - mean) < distance_m).any())
