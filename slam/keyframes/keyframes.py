"""Earlier scans that the rover keeps, and what the present one, laid onto them, says of the pose.

The place of a keyframe is part of the joint Gaussian, so that a scan laid onto one that is seconds old stops the drift
of the dead reckoning, and a scan laid onto one from a lap ago closes the lap. No corner has to be found again for that.
"""

import math

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.arithmetic.functions import arctangent, composed, lengths
from slam.arithmetic.small_matrices import eigen, inverse, squared_distance
from slam.estimate import KeyframeFit
from slam.front_end.alignment_kernels import surface_normals
from slam.front_end.alignment_search import Search
from slam.front_end.deskew import Beams
from slam.front_end.wide_search import LOOSE, View, WideSearch
from slam.joint.gaussian import JointGaussian
from slam.joint.keyframe_axis import poses_of
from slam.joint.state import JointState
from slam.keyframes.far_loops import FarLoops
from slam.keyframes.fits import LEAST_POINTS, OLD, WIDEST_M, Fits
from slam.keyframes.keyframe import Keyframe, Laid
from slam.maps.views import NO_VIEWS, Views, kept_points
from slam.pose import Pose2

NEW_M, NEW_RAD = 1.0, 0.6  # a scan becomes a keyframe where none that fits is so near
STEP_M, STEP_RAD = 0.2, 0.15  # the rover moves or turns so far before another scan is laid onto keyframes
REACH_M, REACH_SHARE = 6.0, 0.45  # keyframes farther away, or turned by more of the field of view, share too little
OLD_REACH_M = 4.0  # of such a keyframe, a radian counted as METRES_PER_RAD
METRES_PER_RAD = 3.0
MOST_OLD = 2  # are tried with one scan
MOST_POINTS = 200  # of a scan are laid onto a keyframe
MOST_BEAMS = 541  # of a keyframe are kept
WITHIN_SIGMAS, WITHIN_SQUARE = 2.5, 14.0  # the pose may be off by so much; 99.7 % of what chance makes of three numbers
FARTHEST_M, FARTHEST_RAD = 15.0, 0.5  # sigma beyond which it is not looked for at all
LYING_M = 0.02  # sigma of its position, m, by its points alone


class Keyframes:
    """Chooses keyframes near the pose, lays the scan onto them and tells the joint Gaussian what came out."""

    def __init__(self, joint: JointGaussian, body_from_laser: Pose2) -> None:
        self._joint = joint
        self._body_from_laser = body_from_laser
        self._laser_from_body = body_from_laser.inverse()
        self._keyframes: list[Keyframe] = []
        self._moved_from: FloatArray | None = None
        self._wanted = False
        self._far = FarLoops()
        self._fits = Fits(joint, self._keyframes, body_from_laser)
        self._turn = 0

    def __len__(self) -> int:
        return len(self._keyframes)

    @property
    def figures(self) -> dict[str, float]:
        """For the record."""
        fits = self._fits
        return {
            "keyframes": float(len(self)),
            "keyframe_fits": float(fits.fitted),
            "loops_closed": float(fits.closed),
            "poses_overruled": float(fits.overruled),
        }

    def constrain(self, beams: Beams) -> bool:
        """Condition the joint Gaussian on how the scan lies on keyframes; True where it was told anything."""
        self._wanted = False
        pose = self._joint.map_from_body
        if self._moved_from is not None:
            since = Pose2(*self._moved_from.tolist()).inverse() @ pose
            if math.hypot(since.x_m, since.y_m) < STEP_M and abs(since.heading_rad) < STEP_RAD:
                return False
        self._moved_from = pose.as_array()
        points = self.thinned(beams)
        if len(points) < LEAST_POINTS:
            return False
        self._wanted = True
        told = False
        between = self._joint.from_keyframes()
        for number in self._candidates(between):
            laid = self._fits.fit(number, points)
            if laid is not None:
                told = True
                self._wanted = self._wanted and not laid.is_near(NEW_M, NEW_RAD)
        told = self._ask_again(points, between) or told
        return self._close_far(beams, points, between) or told

    def keep(self, beams: Beams) -> None:
        """Make the scan a keyframe where no fitting one is near enough; the joint Gaussian stands at its pose."""
        if not self._wanted:
            return
        self._wanted = False
        normals = np.empty_like(beams.points_m)
        surface_normals(beams.points_m, beams.spacing_rad, normals)
        stride = -(-len(beams) // MOST_BEAMS)
        points: FloatArray = beams.points_m[::stride].astype(np.float32)
        self._keyframes.append(
            Keyframe(
                points,
                kept_points(points),
                normals[::stride].astype(np.float32),
                float(arctangent(beams.rays[0, 1], beams.rays[0, 0])),
                stride * beams.spacing_rad,
                self._joint.scans,
            )
        )
        self._joint.add_keyframe()

    def thinned(self, beams: Beams) -> FloatArray:
        """Some of the returns (p, 2), body frame."""
        returned = np.flatnonzero(~np.isnan(beams.ranges_m))
        stride = max(1, -(-len(returned) // MOST_POINTS))
        return self._body_from_laser.transform(beams.points_m[returned[::stride]])

    def take_fits(self) -> tuple[KeyframeFit, ...]:
        """The fits that were believed since the last time."""
        return self._fits.take()

    def views(self, state: JointState, numbers: IntArray) -> Views:
        """What those of these numbers showed, from where a state of the joint Gaussian has them."""
        if not len(numbers):
            return NO_VIEWS
        bodies = poses_of(state.settled_means()[self._joint.keyframe_ends[numbers]])
        points = np.stack([self._keyframes[number].kept_cm for number in numbers.tolist()])
        return Views(composed(bodies, self._body_from_laser.as_array()), points)

    def known_to_metres(self) -> IntArray:
        """Numbers of those from which the pose is known to metres only, or which are out of reach."""
        between = self._joint.from_keyframes()
        return np.array(
            [
                number
                for number in range(len(self._keyframes))
                if not math.isfinite(between[number, 0]) or _sigma_m(self._joint.from_keyframe(number)[1]) > WIDEST_M
            ],
            dtype=np.int64,
        )

    def close_at(self, map_from_body: Pose2, covariance: FloatArray) -> bool:
        """Condition the joint Gaussian on a pose that scans on what these keyframes showed say, with its covariance (3,
        3), as seen from the nearest keyframe; False where that contradicts what is known.
        """
        between = self._joint.from_keyframes()
        numbers = [n for n in self.known_to_metres().tolist() if math.isfinite(between[n, 0])]
        if not numbers:
            return False
        off = self._joint.map_from_body.inverse() @ map_from_body
        bodies = [Pose2(*between[number].tolist()) @ off for number in numbers]
        nearest = int(np.argmin([math.hypot(body.x_m, body.y_m) for body in bodies]))
        information = inverse(covariance)
        laid = Laid(bodies[nearest].as_array(), bodies[nearest].as_array(), information, np.zeros((3, 3)), 0, 0)
        return self._fits.tell(numbers[nearest], laid)

    def lies_on(self, beams: Beams, before_scan: int) -> bool:
        """Whether the scan lies on the nearest keyframe that was made before a scan, where the pose says that it
        should, and says itself where that is, in every direction.
        """
        points = self.thinned(beams)
        apart = self._apart(self._joint.from_keyframes())
        apart[[keyframe.scan >= before_scan for keyframe in self._keyframes]] = math.inf
        if len(points) < LEAST_POINTS or not np.isfinite(apart).any():
            return False
        laid = self._fits.lay(int(np.argmin(apart)), points)
        if laid is None:
            return False
        least_known = eigen((laid.information - laid.held)[:2, :2])[0][0]
        return bool(laid.lies and least_known * LYING_M * LYING_M >= 1.0)

    def know(self, beams: Beams, motion: FloatArray, covariance: FloatArray) -> bool:
        """Whether the scan lies on the nearest keyframe after a motion (3,) with that covariance (3, 3)."""
        points, off = self.thinned(beams), Pose2(*motion.tolist())
        apart = self._apart(composed(self._joint.from_keyframes(), motion))
        if len(points) < LEAST_POINTS or not np.isfinite(apart).any():
            return False
        laid = self._fits.lay(int(np.argmin(apart)), points, off, covariance)
        return laid is not None and laid.lies

    def forget_from(self, number: int) -> None:
        """Forget the keyframes from this number on: they were not taken where the map has them."""
        del self._keyframes[number:]
        self._joint.forget_keyframes(number)
        self._moved_from, self._wanted = None, False
        self._far = FarLoops()
        self._fits.forget_doubt()

    def _apart(self, between: FloatArray) -> FloatArray:
        """(K,) how far each keyframe is away, m and turns counted as such; inf beyond reach."""
        distances, turns = lengths(between[:, :2]), np.abs(between[:, 2])
        reached = (distances < REACH_M) & (turns < self._most_turned())
        return np.where(reached, distances + METRES_PER_RAD * turns, math.inf)

    def _most_turned(self) -> FloatArray:
        """(K,) rad by which the rover may be turned against each keyframe to see enough of the same."""
        return REACH_SHARE * np.array([keyframe.field_of_view_rad for keyframe in self._keyframes])

    def _candidates(self, between: FloatArray) -> list[int]:
        """Numbers of the nearest keyframe and of a few old ones nearby; between (K, 3): the body as seen from each."""
        apart = self._apart(between)
        order = np.argsort(apart, kind="stable")
        order = order[np.isfinite(apart[order])]
        old = order[(order < len(apart) - OLD - 1) & (apart[order] < OLD_REACH_M)][:MOST_OLD]
        return list(dict.fromkeys((*order[:1].tolist(), *old.tolist())))

    def _ask_again(self, points_m: FloatArray, between: FloatArray) -> bool:
        """Where an old keyframe contradicted the joint Gaussian a little while ago, ask another one about the place it
        named; whether the joint Gaussian was told.
        """
        doubted = self._fits.doubted()
        if doubted is None:
            return False
        number, off = doubted
        apart = self._apart(composed(between, off.as_array()))
        apart[number] = math.inf
        apart[max(0, len(apart) - OLD - 1) :] = math.inf
        return bool(np.isfinite(apart).any()) and self._fits.ask_again(int(np.argmin(apart)), points_m, off)

    def _close_far(self, beams: Beams, points_m: FloatArray, between: FloatArray) -> bool:
        """Try one old keyframe from which the pose is known to metres only, the next one the next time; whether the
        joint Gaussian was told of it.

        In turn, the rover is looked for where it should be as seen from a near keyframe, and at the place of one
        that is farther away, as if it had come back there.
        """
        pose, sigma_m = self._joint.map_from_body, math.sqrt(self._joint.covariance[:2, :2].trace())
        if sigma_m < WIDEST_M or not self._far.is_due(pose):
            return False
        self._turn += 1
        is_wide = self._turn % 2 == 1
        far_m = OLD_REACH_M + (WITHIN_SIGMAS if is_wide else 1.0) * sigma_m
        distances, turned = lengths(between[:, :2]), np.abs(between[:, 2]) >= self._most_turned()
        distances[turned] = math.inf
        near = np.flatnonzero(distances[: -OLD - 1] < far_m)
        if len(near) == 0:
            return False
        number = int(near[np.argsort(distances[near], kind="stable")[self._turn // 2 % len(near)]])
        predicted, covariance = self._joint.from_keyframe(number)
        spread = np.diag(covariance)
        if not WIDEST_M < math.sqrt(spread[0] + spread[1]) < FARTHEST_M or math.sqrt(spread[2]) > FARTHEST_RAD:
            return False
        at = predicted * (0.0, 0.0, 1.0) if is_wide else predicted
        if not squared_distance(at - predicted, covariance) < WITHIN_SQUARE:
            return False
        keyframe = self._keyframes[number]
        onto = Search(points_m, keyframe.surfaces(self._laser_from_body))
        search = WideSearch(onto, View.of(beams), keyframe.view, self._body_from_laser)
        found = self._far.find(number, search, at, pose, predicted)
        if found is None:
            return False
        return self._fits.tell(number, Laid(predicted, found.motion, found.information, LOOSE, 0, 0))


def _sigma_m(covariance: FloatArray) -> float:
    return math.sqrt(covariance[0, 0] + covariance[1, 1])
