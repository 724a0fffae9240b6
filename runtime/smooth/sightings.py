"""What the filter was told in a run, scan by scan: motions, which landmark was seen how, and where it put the rover."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from drivers.measurements import BoolArray, FloatArray, IntArray
from runtime.fault_isolation import step_or_predict
from runtime.map_files.start import for_estimator, recorded_start
from runtime.record.reader import RunReader
from runtime.settings.configuration import Configuration
from slam.estimate import Estimate, KeyframeFit, Quality, Recognition
from slam.estimator import Estimator
from slam.observations import IDENTITIES_PER_SCAN, NEW
from slam.pose import Pose2, composed, inverted
from slam.relocalise.local_map import ScanTaken
from slam.scan_search.stretch import NO_POINTS

TICKS_A_REPORT = 25


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Sightings (m,) of landmarks from scans: number of the scan, identity, range m and bearing rad of the laser, and
    their covariance rr m^2, rb m rad, bb rad^2.
    """

    scans: IntArray
    identities: IntArray
    ranges_m: FloatArray
    bearings_rad: FloatArray
    rr: FloatArray
    rb: FloatArray
    bb: FloatArray

    def chosen(self, which: IntArray | BoolArray) -> "Sightings":
        """Some of them, by number or mask."""
        return Sightings(*(getattr(self, name)[which] for name in self.__slots__))


@dataclass(frozen=True, slots=True, eq=False)
class Fits:
    """Scans laid onto earlier ones (f,): the body of `later` as seen from that of `earlier` (f, 3), and the information
    (f, 3, 3) in the axes of `earlier`.
    """

    earlier: IntArray
    later: IntArray
    motions: FloatArray
    informations: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class DriveTold:
    """All that a path can be smoothed from. Poses are of the body.

    stamps_s (n,) of the scans; motions (n, 3) since the scan before with covariances (n, 3, 3), those of the first
    scan are nothing; odometry (n, 3): dead reckoning. filtered (n, 3), covariances (n, 3, 3): what the filter said
    then; known (n,): it was in the map that the run ends in, and not lost. start (n, 3): the same path without what a
    recognition has shown to be wrong. ticks (t, 4): t s and dead reckoning at every tick. final (l,): identities of
    the landmarks that the filter ends with.
    """

    stamps_s: FloatArray
    motions: FloatArray
    motion_covariances: FloatArray
    odometry: FloatArray
    filtered: FloatArray
    covariances: FloatArray
    known: BoolArray
    start: FloatArray
    sightings: Sightings
    fits: Fits
    ticks: FloatArray
    body_from_laser: FloatArray
    final: IntArray


class Witness:
    """Takes down what an estimator is told."""

    def __init__(self) -> None:
        self._scans: list[ScanTaken] = []
        self._rows: list[FloatArray] = []
        self._fits: list[tuple[int, int, KeyframeFit]] = []
        self._keyframes: dict[int, list[int]] = {}
        self._recognised: dict[int, Recognition] = {}
        self._lost: list[bool] = []
        self._ticks: list[tuple[float, ...]] = []
        self._final = np.zeros(0, dtype=np.int64)

    def take(self, taken: ScanTaken) -> None:
        """One scan; its beams, 60 kB, are not kept."""
        number, before = len(self._scans), taken.before
        self._scans.append(replace(taken, seen=replace(taken.seen, laid=None, points_m=NO_POINTS)))
        self._lost.append(True)
        self._rows.append(_sightings(number, taken))
        keyframes = self._keyframes.setdefault(before.map_id, [])
        known = [fit for fit in taken.fits if fit.keyframe < len(keyframes)]
        self._fits.extend((keyframes[fit.keyframe], number, fit) for fit in known)
        del keyframes[before.keyframes :]
        keyframes.extend([number] * (before.keyframes - len(keyframes)))

    def note(self, estimate: Estimate) -> None:
        """What the filter said after a tick."""
        self._ticks.append((estimate.stamp_ns * 1e-9, *estimate.odom_from_body.as_array().tolist()))
        if estimate.landmarks is not None:
            self._final = estimate.landmarks.identities
        if estimate.matches is None or not self._scans:
            return
        taken = self._scans[-1]
        self._lost[-1] = estimate.quality is Quality.LOST
        if estimate.recognition is not None:
            self._recognised[len(self._scans) - 1] = estimate.recognition
            del self._keyframes.setdefault(taken.after.map_id, [])[taken.after.keyframes :]

    def told(self, body_from_laser: FloatArray) -> DriveTold:
        """All of it."""
        scans = self._scans
        columns = np.vstack(self._rows) if scans else np.zeros((0, 7))
        filtered = _poses([taken.map_from_body for taken in scans])
        motions = np.array([taken.measured.mean for taken in scans]).reshape(-1, 3)
        maps = np.array([taken.after.map_id for taken in scans], dtype=np.int64)
        lost = np.array(self._lost, dtype=np.bool_)
        return DriveTold(
            stamps_s=np.array([taken.seen.stamp_ns for taken in scans]) * 1e-9,
            motions=motions,
            motion_covariances=np.array([taken.measured.covariance for taken in scans]).reshape(-1, 3, 3),
            odometry=_poses([taken.odom_from_body for taken in scans]),
            filtered=filtered,
            covariances=np.array([taken.covariance for taken in scans]).reshape(-1, 3, 3),
            known=~lost & (maps == maps[-1]) if scans else lost,
            start=self._in_last_map(filtered, motions, maps),
            sightings=Sightings(columns[:, 0].astype(np.int64), columns[:, 1].astype(np.int64), *columns[:, 2:].T),
            fits=Fits(
                np.array([earlier for earlier, _, _ in self._fits], dtype=np.int64),
                np.array([later for _, later, _ in self._fits], dtype=np.int64),
                np.array([fit.motion for _, _, fit in self._fits]).reshape(-1, 3),
                np.array([fit.information for _, _, fit in self._fits]).reshape(-1, 3, 3),
            ),
            ticks=np.array(self._ticks).reshape(-1, 4),
            body_from_laser=body_from_laser,
            final=self._final,
        )

    def _in_last_map(self, filtered: FloatArray, motions: FloatArray, maps: IntArray) -> FloatArray:
        """(n, 3) poses of the filter, those moved along that a recognition has shown to be wrong."""
        poses = filtered.copy()
        for number, recognition in self._recognised.items():
            if recognition.is_new or number == 0:
                continue
            first = number - self._scans[number].before.unrooted
            if maps[number] != maps[number - 1]:
                others = np.flatnonzero(maps[:number] != maps[number - 1])
                first = 0 if len(others) == 0 else int(others[-1]) + 1
            first = min(max(first, 0), number)
            believed = composed(poses[number - 1], motions[number])
            off = composed(poses[number], inverted(believed))
            poses[first:number] = composed(off, poses[first:number])
        return poses


def read_told(reader: RunReader, configuration: Configuration, progress: Callable[[float], None]) -> DriveTold:
    """Replay a run and take down what its filter was told. Raises NotAMapError where the map it began in is gone."""
    witness = Witness()
    start = for_estimator(recorded_start(reader.header, reader.folder))
    estimator = Estimator(configuration.slam, configuration.seed, start=start, witness=witness.take)
    for number, recorded in enumerate(reader.ticks()):
        estimate, _ = step_or_predict(estimator, recorded.tick)
        witness.note(estimate)
        if number % TICKS_A_REPORT == 0:
            progress(reader.read_fraction)
    return witness.told(configuration.slam.mount.as_pose().as_array())


def _sightings(number: int, taken: ScanTaken) -> FloatArray:
    """(m, 7) columns of Sightings; the feature that made a landmark has seen it too."""
    rows = taken.seen.rows
    made = np.where(
        rows.identities >= 0, rows.identities, (taken.before.scans - 1) * IDENTITIES_PER_SCAN + rows.numbers
    )
    identities = np.where(taken.matched == NEW, made, taken.matched)
    columns = (np.full(len(made), number), identities, rows.ranges_m, rows.bearings_rad, rows.rr, rows.rb, rows.bb)
    return np.column_stack(columns)[identities >= 0]


def _poses(poses: list[Pose2]) -> FloatArray:
    return np.array([pose.as_array() for pose in poses]).reshape(-1, 3)
