"""One of the maps that the rover knows: how it is recognised, and how what is around the rover becomes part of it."""

import math
from dataclasses import dataclass, field

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.arithmetic.small_matrices import squared_distance
from slam.estimate import MapProgress
from slam.front_end.deskew import Beams
from slam.joint.atlas import AWAY
from slam.joint.gaussian import CONFIRMED_LOG_ODDS, KEYFRAME, JointGaussian
from slam.joint.state import JointState
from slam.keyframes.keyframes import METRES_PER_RAD, Keyframes
from slam.maps.joint_map import JointMap, take_map
from slam.maps.views import NO_VIEWS, Views
from slam.pose import Pose2, wrap_rad
from slam.recognise.attempt import Hypothesis
from slam.recognise.confirmation import Confirmation
from slam.recognise.local_points import local_points
from slam.recognise.map_index import MapIndex
from slam.relocalise.join import FAR_MOST_M, LAID, carry_along, condition_on_same, far_landmarks, join, rows_since
from slam.relocalise.joint_compatibility import Conditioned
from slam.relocalise.rooting import Rooting

MODELLED_SQUARE = 16.3  # chi square of three coordinates, 99.9 %: within it the pose drifted as far as was thought
REMEMBER_EVERY, REMEMBER_EVERY_M = 10, 1.0  # scans or way, the map is copied while it is right: some ms if it is large
HEADING_RADPM = 0.1  # times the scale's sigma: what a recognised heading may be off by


@dataclass(frozen=True, slots=True, eq=False)
class Remembered:
    """A map as it was after so many scans, with so many keyframes."""

    state: JointState
    scans: int
    keyframes: int


@dataclass(slots=True, eq=False)
class Island:
    """number: its map id. index: of its rooted landmarks. tried: the local landmarks of the last attempt in it.
    remembered: how it was when rooted landmarks or walls of it were last in view and the pose beyond doubt; asked_scan,
    way_m: when that was last asked, and the way and turns since. is_saved: of an earlier drive; it takes others in and
    is never taken into one. saved_views: of that drive.
    """

    number: int
    joint: JointGaussian
    keyframes: Keyframes
    index: MapIndex
    rooting: Rooting = field(default_factory=Rooting)
    confirmation: Confirmation = field(default_factory=Confirmation)
    tried: tuple[int, ...] = ()
    remembered: Remembered | None = None
    is_saved: bool = False
    saved_views: Views = NO_VIEWS
    asked_scan: int = 0
    way_m: float = 0.0

    def views(self, source: JointGaussian | None = None) -> Views:
        """What was seen from where while the map was right for certain; for a source that is this map itself, from
        where its pose is known to metres only.
        """
        if source is self.joint:
            far = self.keyframes.known_to_metres()
            return self.saved_views.joined(self.keyframes.views(self.joint.state, far))
        kept = self.remembered
        state, count = (self.joint.state, self.rooting.keyframes) if kept is None else (kept.state, kept.keyframes)
        return self.saved_views.joined(self.keyframes.views(state, np.arange(min(count, len(self.keyframes)))))

    def taken(self) -> JointMap:
        """The map as it is now, for a later drive to begin in."""
        views = self.keyframes.views(self.joint.state, np.arange(len(self.keyframes)))
        return take_map(self.joint, self.saved_views.joined(views))

    def follow(self, most_changes: int | None) -> bool:
        """Bring the index up to date with the map as it is remembered; False where changes are left over."""
        state = self.joint.state if self.remembered is None else self.remembered.state
        atlas = state.atlas
        confirmed = (atlas.place >= AWAY) & (atlas.identities != KEYFRAME) & (atlas.log_odds >= CONFIRMED_LOG_ODDS)
        rows = np.flatnonzero(confirmed & self.rooting.is_rooted(atlas.identities))
        return self.index.follow(atlas.identities[rows], state.settled_means()[rows], most_changes)

    def take(self, moved: FloatArray, laid: Beams | None, matched: IntArray) -> None:
        """One scan while the pose was beyond doubt, after a motion (3,): the map is remembered where its landmarks are
        rooted, or where the scan, by its beams, lies on walls that were right. matched (K,): identities or verdicts.
        """
        joint = self.joint
        is_rooted = self.rooting.add(joint.scans, matched, joint.landmark_count, len(self.keyframes))
        self.way_m += math.hypot(moved[0], moved[1]) + METRES_PER_RAD * abs(float(moved[2]))
        if joint.scans - self.asked_scan < REMEMBER_EVERY and self.way_m < REMEMBER_EVERY_M:
            return
        if is_rooted or laid is not None:
            self.asked_scan, self.way_m = joint.scans, 0.0
        if is_rooted or (laid is not None and self.keyframes.lies_on(laid, self.rooted_scans)):
            self.remember()

    @property
    def rooted_scans(self) -> int:
        """How many scans the map had when it was right for certain."""
        return self.rooting.before_scan if self.remembered is None else self.remembered.scans

    @property
    def progress(self) -> MapProgress:
        """How far the map has come."""
        scans = self.joint.scans
        return MapProgress(self.number, scans, len(self.keyframes), scans - self.rooted_scans)

    def remember(self) -> None:
        """The map is right as it is. A slip bends it by chance matches before anybody can notice."""
        self.remembered = Remembered(self.joint.state.copied(), self.joint.scans, len(self.keyframes))

    def restore(self) -> None:
        """The map as it is remembered: the pose may have been wrong since then."""
        if self.remembered is not None:
            self.joint.state = self.remembered.state
            self.keyframes.forget_from(self.remembered.keyframes)
            self.remembered = None

    def expects(self, map_from_body: Pose2) -> bool:
        """Whether a pose in this map is within what the drift of its own pose may be."""
        off = map_from_body.as_array() - self.joint.map_from_body.as_array()
        off[2] = wrap_rad(float(off[2]))
        sigma_m = self.index.scale.sigma_m
        spread = self.joint.covariance + np.diag(np.square((sigma_m, sigma_m, HEADING_RADPM * sigma_m)))
        return squared_distance(off, spread) < MODELLED_SQUARE

    def close_loop(self, found: Hypothesis) -> Conditioned | None:
        """What was made since the rooted part was left is there already: they are one, and nothing jumps."""
        same = dict(zip(found.local.tolist(), found.known.tolist(), strict=True))
        closed = condition_on_same(self.joint, same, self.index.scale)
        if closed is not None:
            self.rooting.root(self.joint.scans, len(self.keyframes))
        return closed

    def close_by_walls(self, map_from_body: Pose2) -> Conditioned | None:
        """The walls around are those that were seen from here before."""
        if not self.keyframes.close_at(map_from_body, LAID):
            return None
        state = self.joint.state
        return Conditioned(state.mean[: state.size], state.covariance[: state.size, : state.size], [], 0.0, 0)

    def take_in(
        self, source: JointGaussian, reach_m: float, found: Hypothesis, map_from_body: Pose2
    ) -> Conditioned | None:
        """Put the rover where it was recognised, with what the source has around it. None where that contradicts, which
        walls never do.

        source: a local map, another map, or this one, whose part since the rooted one was left is laid elsewhere. What
        this map has made since then is taken out: it stands where the pose was wrong. Far away it is turned along where
        that is not far: nobody knows where on the way the pose went wrong.
        """
        joint, scale, since = self.joint, self.index.scale, self.rooted_scans
        keyframes = self.rooting.keyframes if self.remembered is None else self.remembered.keyframes
        points = local_points(source.state, scale, since if source is joint else 0)
        if source is joint:  # what is farther away may have been passed before the pose went wrong
            points = points.within(reach_m, found.local)
        here = source.map_from_body
        new_from_old = map_from_body @ here.inverse()
        along = [far_landmarks(joint, since, points.identities, here, reach_m).turned(new_from_old, FAR_MOST_M)]
        if source is not joint:
            along.append(far_landmarks(source, 0, points.identities, here, reach_m).turned(new_from_old))
        same = dict(zip(found.local.tolist(), found.known.tolist(), strict=True))
        live = joint.state
        if self.remembered is not None:
            joint.state = self.remembered.state.copied()
        joined = join(joint, points, same, map_from_body, scale, rows_since(joint, since), by_scans=found.by_scans)
        if joined is None:
            joint.state = live
            return None
        self.keyframes.forget_from(keyframes)
        for far in along:
            carry_along(joint, far, scale)
        joint.scans, joint.moves = source.scans, source.moves
        self.rooting.root(joint.scans, len(self.keyframes))
        return joined
