"""The scans of a run where the published path has them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drivers.measurements import BoolArray, FloatArray, Scan, VerdictArray
from runtime.record.reader import RunReader
from runtime.settings.configuration import load_configuration_text
from slam.estimate import Estimate, LandmarkMap, Quality
from slam.front_end.deskew import Twist, deskew
from slam.observations import BeamVerdict
from slam.pose import Pose2, wrap_rad
from slam.settings.slam import SlamSettings

STILL_M, STILL_RAD, STILL_NS = 0.05, 0.03, 1_000_000_000
"""Scans of a rover that moved less than this within this time show the same: one of them counts."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacedScan:
    """Ends of the beams of one scan, points_m (n, 2), and of where they came from, both in the map frame.

    solid (n,): False where earlier scans saw through the place: something that moves.
    """

    map_from_body: Pose2
    sensor_m: FloatArray
    points_m: FloatArray
    solid: BoolArray


class PlacedScans:
    """Iterates over the scans of a run whose pose can be believed.

    lost: scans left out because the pose was lost. path_m: positions of all estimates so far. landmarks: the newest.
    """

    def __init__(self, reader: RunReader) -> None:
        configuration = load_configuration_text(reader.header.configuration_text, source=str(reader.folder.path))
        self._settings = configuration.slam
        self._reader = reader
        self.lost = self.scans = 0
        self.path_m: list[tuple[float, float]] = []
        self.landmarks: LandmarkMap | None = None

    def __iter__(self) -> Iterator[PlacedScan]:
        before: Estimate | None = None
        used: tuple[int, Pose2] | None = None
        for recorded in self._reader.ticks():
            estimate, scan = recorded.estimate, recorded.tick.scan
            if estimate is None:
                continue
            self.landmarks = estimate.landmarks or self.landmarks
            self.path_m.append((estimate.map_from_body.x_m, estimate.map_from_body.y_m))
            if isinstance(scan, Scan) and estimate.beam_verdicts is not None:
                self.scans += 1
                pose = at_scan(scan.stamp_ns, before, estimate)
                if estimate.quality is Quality.LOST:
                    self.lost += 1
                elif used is None or _shows_more(used, scan.stamp_ns, pose):
                    used = scan.stamp_ns, pose
                    yield place(scan, pose, twist_between(before, estimate), estimate.beam_verdicts, self._settings)
            before = estimate


def place(scan: Scan, pose: Pose2, twist: Twist, verdicts: VerdictArray, settings: SlamSettings) -> PlacedScan:
    """A scan where the rover was at its stamp, the motion within the sweep undone."""
    mount, view = settings.mount, settings.front_end
    beams = deskew(mount.upright(scan), twist, mount.as_pose(), view.range_min_m, view.range_max_m)
    returned = np.isfinite(beams.ranges_m)
    map_from_laser = pose @ mount.as_pose()
    points_m = map_from_laser.transform(beams.points_m[returned])
    solid = verdicts[returned] != BeamVerdict.MOVED
    return PlacedScan(pose, map_from_laser.as_array()[:2], points_m, solid)


def at_scan(stamp_ns: int, before: Estimate | None, estimate: Estimate) -> Pose2:
    """map_from_body when the scan was measured: the estimate of its tick, led back by dead reckoning."""
    if before is None or not before.stamp_ns < stamp_ns < estimate.stamp_ns:
        return estimate.map_from_body
    step = before.odom_from_body.inverse() @ estimate.odom_from_body
    share = (stamp_ns - before.stamp_ns) / (estimate.stamp_ns - before.stamp_ns)
    part = Pose2(share * step.x_m, share * step.y_m, share * step.heading_rad)
    return estimate.map_from_body @ step.inverse() @ part


def twist_between(before: Estimate | None, estimate: Estimate) -> Twist:
    """Mean velocity of the body since the estimate before, by dead reckoning."""
    if before is None or not before.stamp_ns < estimate.stamp_ns:
        return Twist()
    step = before.odom_from_body.inverse() @ estimate.odom_from_body
    per_s = 1e9 / (estimate.stamp_ns - before.stamp_ns)
    return Twist(step.x_m * per_s, step.y_m * per_s, step.heading_rad * per_s)


def _shows_more(used: tuple[int, Pose2], stamp_ns: int, pose: Pose2) -> bool:
    used_ns, used_pose = used
    moved = abs(pose.x_m - used_pose.x_m) + abs(pose.y_m - used_pose.y_m)
    turned = abs(wrap_rad(pose.heading_rad - used_pose.heading_rad))
    return stamp_ns - used_ns >= STILL_NS or moved >= STILL_M or turned >= STILL_RAD
