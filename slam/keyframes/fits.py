"""Lays a scan onto one keyframe and tells the joint Gaussian what came out, where that can be believed."""

import math

import numpy as np

from drivers.measurements import FloatArray
from slam.arithmetic.small_matrices import applied, inverse, squared_distance
from slam.estimate import KeyframeFit
from slam.front_end.alignment_search import Search
from slam.joint.gaussian import JointGaussian
from slam.keyframes.agreement import Agreement, are_alike, correction_of
from slam.keyframes.keyframe import Keyframe, Laid
from slam.pose import Pose2

OLD = 10  # a keyframe before the last so many closes a loop
WIDEST_M, WIDEST_RAD = 0.7, 0.2  # sigma between pose and keyframe beyond which the search could end in the wrong place
MOUNT_M, MOUNT_RAD = 0.03, 0.01  # what the mount and the sweep may be off by: the search is not held closer than this
LEAST_POINTS, LEAST_SHARE = 30, 0.5  # on surfaces of the keyframe
LARGEST_SQUARE = 50.0  # of a fit that contradicts the filter; farther off it is another place that looks alike
DOUBTED_M = 2.0  # way on which a fit that contradicts the filter waits for a second one
HERE, STANDS = Pose2(), np.zeros((3, 3))


class Fits:
    """Fits of scans on the keyframes of a map, which it shares; the latest that were believed.

    fitted: how many fits were believed; closed: those of them with an old keyframe; overruled: those that contradicted
    the joint Gaussian.
    """

    def __init__(self, joint: JointGaussian, keyframes: list[Keyframe], body_from_laser: Pose2) -> None:
        self._joint = joint
        self._keyframes = keyframes
        self._laser_from_body = body_from_laser.inverse()
        self._doubt = Agreement()
        self._doubted_at = HERE
        self._latest: list[KeyframeFit] = []
        self.fitted = self.closed = self.overruled = 0

    def take(self) -> tuple[KeyframeFit, ...]:
        """The fits that were believed since the last time."""
        latest, self._latest = tuple(self._latest), []
        return latest

    def fit(self, number: int, points_m: FloatArray) -> Laid | None:
        """Lay points (p, 2), body frame, onto a keyframe; None where they do not fit, where the search could end in the
        wrong place, or where that contradicts what is known or closes a loop from afar, and no other keyframe has said
        the same.
        """
        laid = self.lay(number, points_m)
        if laid is None or laid.count < max(LEAST_POINTS, LEAST_SHARE * len(points_m)):
            return None
        closes_from_afar = number < len(self._keyframes) - OLD - 1 and not are_alike(
            Pose2(*laid.predicted.tolist()), Pose2(*laid.motion.tolist())
        )
        if (not closes_from_afar and self.tell(number, laid)) or self._told_by_two(number, laid):
            return laid
        return None

    def lay(self, number: int, points_m: FloatArray, off: Pose2 = HERE, moved: FloatArray = STANDS) -> Laid | None:
        """Lay points (p, 2), body frame, onto a keyframe; None where the search could end in the wrong place.

        off: from the pose of the joint Gaussian, where the body is looked for. moved (3, 3): covariance of the motion
        since then.
        """
        seen, covariance = self._joint.from_keyframe(number)
        covariance = covariance + moved
        spread = np.diag(covariance)
        if math.sqrt(spread[0] + spread[1]) > WIDEST_M or math.sqrt(spread[2]) > WIDEST_RAD:
            return None
        predicted = (Pose2(*seen.tolist()) @ off).as_array() if off is not HERE else seen
        wheels = covariance + np.diag(np.square((MOUNT_M, MOUNT_M, MOUNT_RAD)))
        held = inverse(wheels)
        search = Search(points_m, self._keyframes[number].surfaces(self._laser_from_body))
        motion, information, count = search.best(predicted, wheels)
        return Laid(predicted, motion, information, held, count, len(points_m))

    def forget_doubt(self) -> None:
        """What contradicted the joint Gaussian is forgotten."""
        self._doubt.said_before = None

    def doubted(self) -> tuple[int, Pose2] | None:
        """The keyframe that contradicted the joint Gaussian a little while ago, and where the body would be by that, as
        seen from where it is thought to be; None where there is none.
        """
        said, pose = self._doubt.said_before, self._joint.map_from_body
        if said is None or math.hypot(pose.x_m - self._doubted_at.x_m, pose.y_m - self._doubted_at.y_m) > DOUBTED_M:
            self.forget_doubt()
            return None
        return said[0], pose.inverse() @ said[1] @ pose

    def ask_again(self, number: int, points_m: FloatArray, off: Pose2) -> bool:
        """Ask another keyframe about the place that one has named; whether the joint Gaussian was told."""
        laid = self.lay(number, points_m, off)
        return laid is not None and self._told_by_two(number, laid)

    def tell(self, number: int, laid: Laid) -> bool:
        """Condition the joint Gaussian on how a scan lies on a keyframe; False where it contradicts what is known."""
        predicted, covariance = self._joint.from_keyframe(number)
        off, off_search = laid.motion - predicted, laid.motion - laid.predicted
        off[2], off_search[2] = (math.remainder(turn, 2.0 * math.pi) for turn in (off[2], off_search[2]))
        told = laid.information - laid.held
        spread = inverse(told + 1e-9 * np.eye(3))
        innovation = covariance + spread
        if not squared_distance(off, innovation) < LARGEST_SQUARE:
            return False
        posterior = inverse(told + inverse(covariance))
        by_scan = applied(told, off) + applied(laid.held, off_search)
        self._joint.condition(number, applied(posterior, by_scan), posterior)
        self._latest.append(KeyframeFit(number, predicted + applied(spread, by_scan), told))
        self.fitted += 1
        self.closed += number < len(self._keyframes) - OLD - 1
        return True

    def _told_by_two(self, number: int, laid: Laid) -> bool:
        """A scan lies well on a keyframe, far from where the filter expects it; whether the joint Gaussian was told.

        That may be another place that looks alike: a corridor does a metre on. It is believed when another keyframe
        says the same. Where it contradicts what the filter is sure of, the filter has matched wrongly: then it is told
        as if the rover had slipped by so much, since the map is not what is wrong.
        """
        if not laid.lies:
            return False
        pose = self._joint.map_from_body
        predicted = self._joint.from_keyframe(number)[0]
        correction = correction_of(pose, Pose2(*predicted.tolist()), Pose2(*laid.motion.tolist()))
        self._doubted_at = pose
        if not self._doubt.confirms(number, correction, pose):
            return False
        if self.tell(number, laid):
            return True
        off = (pose.inverse() @ correction @ pose).as_array()
        slip = np.array((math.hypot(off[0], off[1]), math.hypot(off[0], off[1]), off[2]))
        self._joint.predict(np.zeros(3), np.diag(np.square(slip)))
        self.overruled += 1
        return self.tell(number, laid)
