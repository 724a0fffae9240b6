"""Drives as the joint Gaussian is told of them, scan by scan: of a recording, and of a world of point landmarks."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from drivers.measurements import FloatArray, IntArray, OdometryPose
from runtime.importers.data_set import FAST_SPACING_NS, SLOW_SPACING_NS
from runtime.importers.sightings import seen as seen_in
from runtime.importers.ticks import ticks
from runtime.importers.wheel_streams import wheel_samples
from runtime.studies.paper.drives.arms import PROPOSED
from runtime.studies.paper.drives.feature_drive import SIGHT, feature_settings
from runtime.studies.paper.drives.feature_vote import FeatureVote
from runtime.studies.paper.drives.worlds import FeatureDrive, WorldKind, feature_world
from runtime.studies.places.recordings import archive_of, prepared
from slam.estimator import Estimator
from slam.front_end.deskew import Twist
from slam.front_end.front_ends import GivenFrontEnd
from slam.maps.joint_map import JointMap
from slam.observations import usable_rows
from slam.odometry.odometry import Odometry
from slam.relocalise.local_map import ScanSeen, ScanTaken
from slam.settings.slam import SlamSettings


@dataclass(frozen=True, slots=True, eq=False)
class ToldDrive:
    """seen: what the joint Gaussian was told of each scan. poses (n, 3), map_from_body: the truth, or the product's own
    where there is none. matched: identities or verdicts that each scan's features got (empty where nobody asks).
    maps: what a rover had saved after so many scans.
    """

    settings: SlamSettings
    seen: tuple[ScanSeen, ...]
    poses: FloatArray
    matched: tuple[IntArray, ...]
    maps: dict[int, JointMap]

    def driven_m(self, first: int, last: int) -> float:
        """Way between two scans, by the increments."""
        return float(sum(np.hypot(*scan.increment_mean[:2]) for scan in self.seen[first + 1 : last + 1]))


@lru_cache(maxsize=8)
def recorded(data: str, name: str, shares: tuple[float, ...]) -> ToldDrive:
    """A recording with the set's own file, and the maps after these shares of its scans. Raises DataSetError.

    One particle: the published pose does not depend on their number.
    """
    archive, configuration = prepared(archive_of(Path(data), name), own=True)
    settings = SlamSettings.model_validate(configuration.slam.model_dump() | {"particles": 1})
    scans, wheels = list(seen_in(archive)), wheel_samples(archive, configuration.vehicle)
    spacing_ns = SLOW_SPACING_NS if isinstance(wheels[0], OdometryPose) else FAST_SPACING_NS
    taken: list[ScanTaken] = []
    estimator = Estimator(settings, 1, witness=taken.append)
    wanted = {round(share * len(scans)) for share in shares}
    maps = {}
    for tick in ticks(scans, wheels, spacing_ns):
        estimator.step(tick.stamp_ns, tick.scan, tick.wheels)
        if len(taken) in wanted and len(taken) not in maps:
            maps[len(taken)] = estimator.joint_map()
    poses = np.array([scan.map_from_body.as_array() for scan in taken])
    return ToldDrive(settings, tuple(scan.seen for scan in taken), poses, tuple(scan.matched for scan in taken), maps)


def told_world(kind: WorldKind, seed: int, drive: int, exchanged: float = 0.0) -> ToldDrive:
    """One drive through a world of point landmarks in the frame of its start; another `drive` has other noise and
    people, and a share of the landmarks exchanged for as many elsewhere.
    """
    return told_features(feature_world(kind, seed, drive=drive, exchanged=exchanged))


def told_features(drive: FeatureDrive) -> ToldDrive:
    """The same for a drive that is at hand."""
    settings = feature_settings(PROPOSED, 1)
    odometry, front_end = Odometry(settings.odometry), GivenFrontEnd(settings.front_end)
    vote = FeatureVote(difference=True, sparse=True)
    seen = []
    for number, step in enumerate(drive.steps):
        odometry.add(step.wheels)
        increment = odometry.take_until(step.stamp_ns)
        if number == 0:
            increment = replace(increment, covariance=np.zeros((3, 3)))
        features, _ = front_end.observe(step.sightings, odometry.odom_from_body, Twist(), increment.at_rest)
        rows = usable_rows(vote(features, odometry.odom_from_body), settings.view.range_max_m, 0.0)
        mean, covariance = increment.mean, increment.covariance
        seen.append(ScanSeen(step.stamp_ns, mean, covariance, rows, SIGHT, None))
    start = drive.steps[0].truth.inverse()
    poses = np.array([(start @ step.truth).as_array() for step in drive.steps])
    return ToldDrive(settings, tuple(seen), poses, (), {})
