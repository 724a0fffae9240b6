"""The part of the estimator that makes the published pose, without particles: it is told scan after scan."""

from dataclasses import replace

import numpy as np

from drivers.measurements import FloatArray
from slam.estimate import Recognition
from slam.joint.evidence import Confidence
from slam.maps.joint_map import JointMap
from slam.maps.start import MapStart, first_maps
from slam.maps.views import NO_VIEWS
from slam.pose import Pose2
from slam.quality import QualityMonitor
from slam.relocalise.local_map import ScanSeen
from slam.relocalise.relocaliser import Relocaliser
from slam.settings.slam import SlamSettings


class StudiedRover:
    """start: the saved map that its drive begins in."""

    def __init__(self, settings: SlamSettings, start: MapStart | None = None) -> None:
        self.joint, saved = first_maps(settings, start)
        views = NO_VIEWS if start is None else start.known.views
        self.relocaliser = Relocaliser(settings, self.joint, saved, views)
        self.quality = QualityMonitor(settings.quality, self.joint.scans, is_told=saved is self.joint)
        self._has_begun = False

    def step(self, seen: ScanSeen) -> Recognition | None:
        """One scan; the first has no motion before it, wherever in a recording it stands."""
        is_first, self._has_begun = not self._has_begun, True
        if is_first:
            seen = replace(seen, increment_mean=np.zeros(3), increment_covariance=np.zeros((3, 3)))
        joint, quality = self.joint, self.quality
        joint.predict(seen.increment_mean, seen.increment_covariance)
        hints = np.full(seen.rows.ranges_m.size, -1, dtype=np.int64)
        confidence = Confidence(quality.settled_before, quality.map_is_kept)
        matched = joint.observe(seen.rows, hints, seen.sight, confidence, begins=is_first)
        quality.add(seen.stamp_ns, joint.evidence, seen.seen_before_share)
        recognition = self.relocaliser.step(seen, matched, quality)
        if recognition is not None:
            self.joint = self.relocaliser.here.joint
        return recognition

    @property
    def pose(self) -> Pose2:
        """map_from_body."""
        return self.joint.map_from_body

    @property
    def covariance(self) -> FloatArray:
        """(3, 3) of it."""
        return self.joint.covariance

    def saved(self) -> JointMap:
        """The map as it is now."""
        return self.relocaliser.lasting.taken()
