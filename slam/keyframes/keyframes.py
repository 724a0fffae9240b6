"""Earlier scans that the rover keeps, and what the present one, laid onto them, says of the pose.

The place of a keyframe is part of the joint Gaussian, so that a scan laid onto one that is seconds old stops the drift
of the dead reckoning, and a scan laid onto one from a lap ago closes the lap. No corner has to be found again for that.
"""

import math

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.estimate import KeyframeFit
from slam.front_end.alignment_kernels import surface_normals
from slam.front_end.alignment_search import Search
from slam.front_end.deskew import Beams
from slam.front_end.wide_search import LOOSE, View, WideSearch
from slam.joint.gaussian import JointGaussian
from slam.joint.keyframe_axis import poses_of
from slam.joint.state import JointState
from slam.keyframes.far_loops import FarLoops
from slam.keyframes.keyframe import Keyframe, Laid
from slam.maps.views import NO_VIEWS, Views, kept_points
from slam.pose import Pose2, composed

STEP_M, STEP_RAD = 0.2, 0.15  # the rover moves or turns so far before another scan is laid onto keyframes
NEW_M, NEW_RAD = 1.0, 0.6  # a scan becomes a keyframe where none that fits is so near
REACH_M, REACH_SHARE = 6.0, 0.45  # keyframes farther away, or turned by more of the field of view, share too little
OLD = 10  # a keyframe before the last so many closes a loop
OLD_REACH_M = 4.0  # of such a keyframe, a radian counted as METRES_PER_RAD
METRES_PER_RAD = 3.0
MOST_OLD = 2  # are tried with one scan
WIDEST_M, WIDEST_RAD = 0.7, 0.2  # sigma between pose and keyframe beyond which the search could end in the wrong place
MOUNT_M, MOUNT_RAD = 0.03, 0.01  # what the mount and the sweep may be off by: the search is not held closer than this
MOST_POINTS = 200  # of a scan are laid onto a keyframe
MOST_BEAMS = 541  # of a keyframe are kept
LEAST_POINTS, LEAST_SHARE = 30, 0.5  # on surfaces of the keyframe
WITHIN_SIGMAS, WITHIN_SQUARE = 2.5, 14.0  # the pose may be off by so much; 99.7 % of what chance makes of three numbers
FARTHEST_M, FARTHEST_RAD = 15.0, 0.5  # sigma beyond which it is not looked for at all
LARGEST_SQUARE = 50.0  # of a fit that contradicts the filter; farther off it is another place that looks alike
LYING_SHARE = 0.6  # of the points of a scan that lies on the map; from a wrong pose one in a hundred does
LYING_M = 0.02  # sigma of its position, m, by its points alone
INFORMATION_SHARE = 0.3  # of a fit's own claim: neighbouring scans share the errors of the keyframe


class Keyframes:
    """Chooses keyframes near the pose, lays the scan onto them and tells the joint Gaussian what came out.

    fitted: how many fits were believed; closed: those of them with an old keyframe.
    """

    def __init__(self, joint: JointGaussian, body_from_laser: Pose2) -> None:
        self._joint = joint
        self._body_from_laser = body_from_laser
        self._laser_from_body = body_from_laser.inverse()
        self._keyframes: list[Keyframe] = []
        self._moved_from: FloatArray | None = None
        self._wanted = False
        self._far = FarLoops()
        self._turn = 0
        self._fits: list[KeyframeFit] = []
        self.fitted = 0
        self.closed = 0

    def __len__(self) -> int:
        return len(self._keyframes)

    @property
    def figures(self) -> dict[str, float]:
        """For the record."""
        return {"keyframes": float(len(self)), "keyframe_fits": float(self.fitted), "loops_closed": float(self.closed)}

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
            near = self._fit(number, points)
            if near is not None:
                told = True
                self._wanted = self._wanted and not near
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
                float(math.atan2(beams.rays[0, 1], beams.rays[0, 0])),
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
        fits, self._fits = tuple(self._fits), []
        return fits

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
        information: FloatArray = np.asarray(np.linalg.inv(covariance) / INFORMATION_SHARE, dtype=np.float64)
        return self._tell(numbers[nearest], bodies[nearest].as_array(), information, np.zeros((3, 3)))

    def lies_on(self, beams: Beams, before_scan: int) -> bool:
        """Whether the scan lies on the nearest keyframe that was made before a scan, where the pose says that it
        should, and says itself where that is, in every direction.
        """
        points = self.thinned(beams)
        apart = self._apart(self._joint.from_keyframes())
        apart[[keyframe.scan >= before_scan for keyframe in self._keyframes]] = math.inf
        if len(points) < LEAST_POINTS or not np.isfinite(apart).any():
            return False
        laid = self._lay(int(np.argmin(apart)), points)
        if laid is None:
            return False
        least_known = np.linalg.eigvalsh((laid.information - laid.held)[:2, :2])[0]
        return bool(laid.count >= LYING_SHARE * len(points) and least_known >= LYING_M**-2)

    def forget_from(self, number: int) -> None:
        """Forget the keyframes from this number on: they were not taken where the map has them."""
        del self._keyframes[number:]
        self._joint.forget_keyframes(number)
        self._moved_from, self._wanted = None, False
        self._far = FarLoops()

    def _apart(self, between: FloatArray) -> FloatArray:
        """(K,) how far each keyframe is away, m and turns counted as such; inf beyond reach."""
        distances, turns = np.hypot(between[:, 0], between[:, 1]), np.abs(between[:, 2])
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

    def _fit(self, number: int, points_m: FloatArray) -> bool | None:
        """Lay points (p, 2), body frame, onto a keyframe; None where they do not fit, or where the search could end in
        the wrong place, else whether it is near.
        """
        laid = self._lay(number, points_m)
        if laid is None or laid.count < max(LEAST_POINTS, LEAST_SHARE * len(points_m)):
            return None
        if not self._tell(number, laid.motion, laid.information, laid.held):
            return None
        return bool(math.hypot(laid.predicted[0], laid.predicted[1]) < NEW_M and abs(laid.predicted[2]) < NEW_RAD)

    def _lay(self, number: int, points_m: FloatArray) -> Laid | None:
        """Lay points (p, 2), body frame, onto a keyframe; None where the search could end in the wrong place."""
        predicted, covariance = self._joint.from_keyframe(number)
        spread = np.diag(covariance)
        if math.sqrt(spread[0] + spread[1]) > WIDEST_M or math.sqrt(spread[2]) > WIDEST_RAD:
            return None
        wheels = covariance + np.diag((MOUNT_M**2, MOUNT_M**2, MOUNT_RAD**2))
        search = Search(points_m, self._keyframes[number].surfaces(self._laser_from_body))
        motion, information, count = search.best(predicted, wheels)
        return Laid(predicted, motion, information, np.asarray(np.linalg.inv(wheels), dtype=np.float64), count)

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
        distances, turned = np.hypot(between[:, 0], between[:, 1]), np.abs(between[:, 2]) >= self._most_turned()
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
        if not _square(at - predicted, covariance) < WITHIN_SQUARE:
            return False
        keyframe = self._keyframes[number]
        onto = Search(points_m, keyframe.surfaces(self._laser_from_body))
        search = WideSearch(onto, View.of(beams), keyframe.view, self._body_from_laser)
        found = self._far.find(number, search, at, pose, predicted)
        return found is not None and self._tell(number, found.motion, found.information, LOOSE)

    def _tell(self, number: int, motion: FloatArray, information: FloatArray, held: FloatArray) -> bool:
        """Condition the joint Gaussian on a fit (3,) with its information (3, 3), of which held (3, 3) came from the
        search's own prior; False where it contradicts what is known.
        """
        predicted, covariance = self._joint.from_keyframe(number)
        off = motion - predicted
        off[2] = math.remainder(off[2], 2.0 * math.pi)
        told = INFORMATION_SHARE * (information - held)
        spread = np.linalg.inv(told + 1e-9 * np.eye(3))
        innovation = covariance + spread
        if not off @ np.linalg.solve(innovation, off) < LARGEST_SQUARE:
            return False
        posterior = np.linalg.inv(told + np.linalg.inv(covariance))
        by_scan = told @ off + INFORMATION_SHARE * (held @ off)
        self._joint.condition(number, posterior @ by_scan, posterior)
        self._fits.append(KeyframeFit(number, predicted + spread @ by_scan, told))
        self.fitted += 1
        self.closed += number < len(self._keyframes) - OLD - 1
        return True


def _sigma_m(covariance: FloatArray) -> float:
    return math.sqrt(covariance[0, 0] + covariance[1, 1])


def _square(off: FloatArray, covariance: FloatArray) -> float:
    return float(off @ np.linalg.solve(covariance, off))
