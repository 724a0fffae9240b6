"""The map of a joint Gaussian without the drive that made it: what a later drive begins with.

Pose, constants of the odometry and keyframes are marginalised out, and so is every landmark that is not confirmed. In a
covariance that is leaving out its rows; where a landmark outside the state hangs on one of them, it is hung on others
first. What was seen from the keyframes is kept, so that the place is known again by its walls.
"""

import copy
import hashlib
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import BoolArray, FloatArray, IntArray
from slam.arithmetic.small_matrices import carried, product, pseudo_inverse
from slam.estimate import LandmarkMap
from slam.joint.atlas import AWAY, PARENTS
from slam.joint.evidence import SETTLED_SCANS
from slam.joint.gaussian import CONFIRMED_LOG_ODDS, KEYFRAME, JointGaussian
from slam.joint.measurement import FIRST_PLACE
from slam.joint.state import JointState
from slam.joint.window import ORPHAN
from slam.maps.views import MOST_VIEWS, NO_VIEWS, CentimetreArray, Views
from slam.pose import Pose2

MOST_DENSE = 4096  # points that are taken into one state to hang them anew: half a gigabyte for a moment
NEIGHBOURS = 16  # landmarks that a pose is tied to when it is given in the frame of a map


@dataclass(frozen=True, slots=True, eq=False)
class JointMap:
    """Landmarks (L,), those in the state first; arrays are read-only.

    identities, log_odds of existence; looks, finds, missed: see slam.joint.evidence.DetectionRates, and after_miss (2,)
    of all together. means_m (L, 2), covariances_m2 (L, 2, 2): of those outside the state as they were when they left
    it. block_m2 (2 s, 2 s): joint covariance of the s in the state. parents (L, 4): numbers of the landmarks that one
    outside the state hangs on (ORPHAN: none), every landmark after its parents; weights (L, 2, 8), residuals (L, 2, 2).
    scans: how many the drive had; new landmarks of a later one are named from there on. view_poses, view_points_cm: of
    its views.
    """

    identities: IntArray
    log_odds: FloatArray
    looks: FloatArray
    finds: FloatArray
    missed: BoolArray
    means_m: FloatArray
    covariances_m2: FloatArray
    parents: IntArray
    weights: FloatArray
    residuals: FloatArray
    block_m2: FloatArray
    after_miss: FloatArray
    scans: int
    view_poses: FloatArray = field(default_factory=NO_VIEWS.poses.copy)
    view_points_cm: CentimetreArray = field(default_factory=NO_VIEWS.points_cm.copy)

    def __post_init__(self) -> None:
        for array in self.arrays.values():
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.identities)

    @property
    def in_state(self) -> int:
        """How many landmarks the joint covariance has."""
        return len(self.block_m2) // 2

    @property
    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Everything but the number of scans, by name."""
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name != "scans"}

    @property
    def views(self) -> Views:
        """What was seen from where."""
        return Views(self.view_poses, self.view_points_cm)

    @property
    def landmarks(self) -> LandmarkMap:
        """As they are published."""
        covariances = self.covariances_m2.copy()
        for number in range(self.in_state):
            covariances[number] = self.block_m2[2 * number : 2 * number + 2, 2 * number : 2 * number + 2]
        return LandmarkMap(self.identities, self.means_m, covariances, self.log_odds)

    def digest(self) -> bytes:
        """32 bytes over everything; two maps are the same where it is."""
        sha = hashlib.sha256(str(self.scans).encode())
        for array in self.arrays.values():
            sha.update(np.ascontiguousarray(array).data)
        return sha.digest()


def take_map(joint: JointGaussian, views: Views = NO_VIEWS) -> JointMap:
    """The confirmed landmarks of a joint Gaussian, which is not changed, and the views of its keyframes, thinned where
    they are too many.
    """
    state, views = joint.state, views.thinned(MOST_VIEWS)
    kept = _kept(state)
    away = np.flatnonzero(kept & (state.atlas.place == AWAY))
    parents = state.atlas.parents[away]
    if ((parents >= 0) & ~kept[parents]).any():
        state = _without(state, kept)
    atlas, order = state.atlas, state.rows[kept[state.rows]]
    places = (atlas.place[order][:, None] + np.arange(2)).ravel()
    block = state.covariance[np.ix_(places, places)]
    outside = atlas.with_ancestors(np.flatnonzero(kept & (atlas.place == AWAY)).tolist())
    rows = np.concatenate((order, np.array(outside, dtype=np.int64)))
    numbers = np.full(len(kept) + 1, ORPHAN, dtype=np.int64)  # the last entry stands for ORPHAN
    numbers[rows] = np.arange(len(rows))
    hangs = np.arange(len(rows)) >= len(order)
    return JointMap(
        identities=atlas.identities[rows],
        log_odds=atlas.log_odds[rows],
        looks=atlas.looks[rows],
        finds=atlas.finds[rows],
        missed=atlas.missed[rows],
        means_m=state.settled_means()[rows],
        covariances_m2=np.where(hangs[:, None, None], atlas.covariances[rows], 0.0),
        parents=np.where(hangs[:, None], numbers[atlas.parents[rows]], ORPHAN),
        weights=np.where(hangs[:, None, None], atlas.weights[rows], 0.0),
        residuals=np.where(hangs[:, None, None], atlas.residuals[rows], 0.0),
        block_m2=block,
        after_miss=joint.after_miss.copy(),
        scans=joint.scans,
        view_poses=views.poses.copy(),
        view_points_cm=views.points_cm.copy(),
    )


def put_map(joint: JointGaussian, known: JointMap, frozen: bool = False) -> None:
    """Give the landmarks of an earlier drive to a joint Gaussian that has none; its pose is worth nothing yet.

    frozen: nothing that it sees may change them.
    """
    state, atlas = joint.state, joint.state.atlas
    inside = known.in_state
    rows = np.zeros(len(known) + 1, dtype=np.int64)
    rows[-1] = ORPHAN
    for number, (identity, log_odds) in enumerate(zip(known.identities.tolist(), known.log_odds.tolist(), strict=True)):
        if number < inside:
            rows[number] = state.adopt(identity, log_odds, known.means_m[number])
        else:
            rows[number] = atlas.add(identity, log_odds, AWAY)
    own = rows[:-1]
    atlas.means[own], atlas.covariances[own] = known.means_m, known.landmarks.covariances_m2
    atlas.looks[own], atlas.finds[own], atlas.missed[own] = known.looks, known.finds, known.missed
    atlas.parents[own] = rows[known.parents]
    atlas.parent_means[own] = known.means_m[known.parents].reshape(-1, 2 * PARENTS)
    atlas.weights[own], atlas.residuals[own] = known.weights, known.residuals
    atlas.frozen[own] = frozen
    for row in own[inside:].tolist():
        atlas.put_away(row)
    state.covariance[FIRST_PLACE : state.size, FIRST_PLACE : state.size] = known.block_m2
    joint.after_miss = known.after_miss.copy()
    joint.scans = known.scans + SETTLED_SCANS  # so that all of them have stood for long


def tie_pose(joint: JointGaussian, pose: Pose2, spread: FloatArray) -> None:
    """Let the rover stand at a pose that somebody read off the map, give or take spread (3, 3).

    What was read off is where it stands among the landmarks there: their common error is the pose's as well. Taken for
    independent of it, the first sightings would move the map instead of the pose.
    """
    state = joint.state
    state.mean[:3] = pose.as_array()
    state.bring_back()
    nearest = np.argsort(np.square(state.points_m - state.mean[:2]).sum(axis=1), kind="stable")[:NEIGHBOURS]
    offsets = state.points_m[nearest] - state.mean[:2]
    by_pose = np.tile(np.eye(2, 3), (len(nearest), 1))
    by_pose[0::2, 2], by_pose[1::2, 2] = -offsets[:, 1], offsets[:, 0]
    of_landmarks = product(pseudo_inverse(product(by_pose.T, by_pose)), by_pose.T)
    places = (FIRST_PLACE + 2 * nearest[:, None] + np.arange(2)).ravel()
    n, covariance = state.size, state.covariance
    covariance[:3, 3:n] = product(of_landmarks, covariance[places, 3:n])
    covariance[3:n, :3] = covariance[:3, 3:n].T
    covariance[:3, :3] = carried(of_landmarks, covariance[np.ix_(places, places)]) + spread


def _kept(state: JointState) -> BoolArray:
    """(R,) rows that belong into a map."""
    atlas = state.atlas
    kept: BoolArray = (atlas.place >= AWAY) & (atlas.identities != KEYFRAME) & (atlas.log_odds >= CONFIRMED_LOG_ODDS)
    return kept


def _without(state: JointState, kept: BoolArray) -> JointState:
    """A copy in which landmarks outside the state hang on kept (R,) ones only.

    Everything comes into one state, the others leave it for good, and those that were outside leave it again. Where
    that would be too large, what hangs on others stands alone, with twice its covariance.
    """
    whole = copy.deepcopy(state)
    atlas = whole.atlas
    if atlas.count > MOST_DENSE:
        atlas.means, atlas.parent_means = atlas.settled(whole.rows, whole.points_m)
        parents = atlas.parents
        alone = np.flatnonzero((atlas.place == AWAY) & ((parents >= 0) & ~kept[parents]).any(axis=1))
        atlas.parents[alone] = ORPHAN
        atlas.covariances[alone] *= 2.0
        return whole
    returned = whole.bring_all_back()
    for number in np.flatnonzero(~kept[whole.rows])[::-1].tolist():
        whole.remove(number)
    for row in reversed(returned):
        if kept[row]:
            whole.put_row_away(row)
    return whole
