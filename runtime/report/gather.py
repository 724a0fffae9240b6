"""The one pass over a run that leaves RunFacts."""

import math
from array import array
from contextlib import suppress
from pathlib import Path

import numpy as np

from drivers.measurements import Event, FloatArray, OdometryPose, Scan, SpeedSteering, WheelCounts
from runtime.calibrate.drive_data import DriveData
from runtime.errors import NotAMapError, UsageError
from runtime.evaluate.evaluate import against_data_set, against_simulation, nothing_known
from runtime.evaluate.smoothed import read_smoothed
from runtime.evaluate.truth import DataSetTruth
from runtime.maps.scan_picture import ScanCells
from runtime.messages.recorded_tick import RecordedTick
from runtime.printable import printable
from runtime.record.reader import RunReader
from runtime.record.room import is_being_written
from runtime.record.trajectories import Trajectories, searched_rows, with_estimates
from runtime.report.device_clock import DeviceClockReader
from runtime.report.facts import QUALITIES, RunFacts, ScanColumns, TickColumns, WheelColumns
from runtime.report.named_columns import NamedColumns
from runtime.review.ticks import BeamPoints, Motion
from runtime.settings.configuration import Configuration, load_configuration_text
from runtime.tick import of_its_time
from slam.estimate import Estimate, LandmarkMap, Quality
from slam.observations import BeamVerdict
from slam.settings.slam import SlamSettings

REST_SCANS = 20  # the first scans, all of them: they stand still and show the range noise
SCAN_APART_NS = 240_000_000  # then one in 0.25 s suffices for matching and costs a third
NEAR_M = 6.0  # who walks along is within; bushes and walls, whose edges come and go, are farther from the course
MOST_SCANS = 1200  # five minutes of driving show 0.4 % of a wheel; 10 MB, and half of the time of a review
AFTER_NS = 5_000_000_000  # the wheels' samples are kept this much longer than scans: latencies are far below
NOWHERE = (math.nan,) * 3
UNKNOWN_M2 = 1e12  # a covariance that is none
TICK_FIGURES, SCAN_FIGURES, WHEEL_FIGURES = 18, 5, 4  # of a row


def gather(run: Path) -> RunFacts:
    """Facts of a run; of the newest replay inside it if the run was imported.

    Raises NotARunError, ConfigurationError; UsageError where there are no estimates yet.
    """
    inputs = RunReader(run)
    reader = with_estimates(inputs)
    configuration = load_configuration_text(reader.header.configuration_text, source=f"configuration of {run}")
    pass_, clock = Gathering(configuration.slam), DeviceClockReader()
    for recorded in reader.ticks(clock.feed):
        pass_.take(recorded)
    if not pass_.rows:
        if not pass_.ticks:
            why = f": {reader.truncated}" if reader.truncated else ""
            raise UsageError(f"{reader.folder.path} holds no complete tick, so there is nothing to review{why}")
        raise UsageError(f"{reader.folder.path} holds no estimates; replay it first: infant replay {run}")
    return pass_.facts(reader, inputs, configuration, clock)


class Gathering:
    """Rows that grow tick by tick; only numbers stay, and some scans."""

    def __init__(self, settings: SlamSettings) -> None:
        self._mount, self._view = settings.mount, settings.front_end
        self._before: Estimate | None = None
        self._cells, self._beams = ScanCells(), BeamPoints()
        self.rows = array("d")
        self.ticks = 0
        self._counts, self._stages = NamedColumns(), NamedColumns()
        self._scans, self._wheels = array("d"), array("d")
        self._kept: list[Scan] = []
        self._samples: list[WheelCounts] = []
        self._speeds: list[SpeedSteering] = []
        self._poses: list[OdometryPose] = []
        self._events: list[Event] = []
        self._defects: list[tuple[float, str]] = []
        self._landmarks: LandmarkMap | None = None
        self._origin_ns: int | None = None

    def take(self, recorded: RecordedTick) -> None:
        """One tick; those without an estimate count with their inputs only."""
        tick, estimate, timing, truth = of_its_time(recorded.tick), recorded.estimate, recorded.timing, recorded.truth
        self.ticks += 1
        if self._origin_ns is None:
            self._origin_ns = tick.stamp_ns
        self._events.extend(tick.events)
        for sample in tick.wheels:
            counts = (math.nan, math.nan, True)
            if isinstance(sample, WheelCounts):
                counts = (sample.left, sample.right, sample.valid)
            self._wheels.extend((self._seconds(sample.stamp_ns), *counts))
            if self._has_scans_for_all_before(sample.stamp_ns):
                continue
            if isinstance(sample, WheelCounts):
                self._samples.append(sample)
            elif isinstance(sample, SpeedSteering):
                self._speeds.append(sample)
            elif isinstance(sample, OdometryPose):
                self._poses.append(sample)
        if tick.scan is not None:
            self._take_scan(tick.stamp_ns, tick.scan, estimate)
        if estimate is None:
            return
        if reason := recorded.defect:
            self._defects.append((self._seconds(tick.stamp_ns), reason))
        if estimate.landmarks is not None:
            self._landmarks = estimate.landmarks
        (xx, _, _), (xy, yy, _), _ = estimate.covariance.tolist()
        pose, odometry, mean = estimate.map_from_body, estimate.odom_from_body, estimate.particle_mean
        self.rows.extend(
            (
                self._seconds(tick.stamp_ns),
                *(pose.x_m, pose.y_m, pose.heading_rad),
                *(odometry.x_m, odometry.y_m, odometry.heading_rad),
                *(NOWHERE if truth is None else (truth.x_m, truth.y_m, truth.heading_rad)),
                *(xx, xy, yy),
                *(mean.x_m, mean.y_m),
                QUALITIES.index(estimate.quality.value),
                math.nan if timing is None else timing.lateness_ns * 1e-6,
                0.0 if timing is None else timing.missed,
            )
        )
        self._before = estimate
        self._counts.add(estimate.counts)
        self._stages.add({} if timing is None else timing.stages_ns)

    def facts(
        self, reader: RunReader, inputs: RunReader, configuration: Configuration, clock: DeviceClockReader
    ) -> RunFacts:
        """Everything as columns. reader: of the estimates; inputs: of the run, the same unless it was imported."""
        name = printable(inputs.folder.path.name)
        rows = _table(self.rows, TICK_FIGURES)
        covariances_m2 = rows[:, (10, 11, 11, 12)].reshape(-1, 2, 2)
        ticks = TickColumns(
            rows[:, 0],
            rows[:, 1:4],
            rows[:, 4:7],
            rows[:, 7:10],
            np.sqrt(np.maximum(np.linalg.eigvalsh(np.nan_to_num(covariances_m2, nan=UNKNOWN_M2))[:, -1], 0.0)),
            np.hypot(*(rows[:, 1:3] - rows[:, 13:15]).T),
            rows[:, 15].astype(np.int64),
            rows[:, 16],
            rows[:, 17],
            self._stages.arrays(1e-6),
            self._counts.arrays(),
        )
        scans, wheels = _table(self._scans, SCAN_FIGURES), _table(self._wheels, WHEEL_FIGURES)
        assert self._origin_ns is not None  # there are rows
        return RunFacts(
            name=name,
            source=reader.header.source,
            created_utc=reader.header.created_utc,
            configuration=configuration,
            versions=dict(reader.header.versions),
            origin_ns=self._origin_ns,
            ticks=ticks,
            scans=ScanColumns(*scans.T),
            wheels=WheelColumns(wheels[:, 0], wheels[:, 1:3], wheels[:, 3] > 0.0),
            device_clock=clock.columns(self._origin_ns),
            events=tuple(self._events),
            gaps=tuple(reader.gaps),
            truncated=reader.truncated,
            landmarks=self._landmarks,
            drive=self._drive(name),
            accuracy=_accuracy(ticks, self._origin_ns, inputs, configuration),
            imported=inputs.header.is_of_others,
            defects=tuple(self._defects),
            known_map=_known_map(reader),
            smoothed=read_smoothed(inputs.folder, reader.folder),
            scan_picture=self._cells.picture(),
            recording=is_being_written(reader.folder.mcap_path),
        )

    def _take_scan(self, beat_ns: int, scan: object, estimate: Estimate | None) -> None:
        moved = near = returned = math.nan
        stamp_ns = getattr(scan, "stamp_ns", beat_ns)
        if isinstance(scan, Scan):
            scan = self._mount.upright(scan)
            self._lay(scan, estimate)
            back = np.isfinite(scan.ranges_m) & (scan.ranges_m < scan.range_max_m)
            answers = int(np.count_nonzero(back))
            returned = answers / back.size if back.size else math.nan
            if estimate is not None and estimate.beam_verdicts is not None:
                refused = (estimate.beam_verdicts == BeamVerdict.MOVED) & back
                moved = np.count_nonzero(refused) / max(1, answers)
                near = np.count_nonzero(refused & (scan.ranges_m < NEAR_M)) / max(1, answers)
            early = len(self._kept) < REST_SCANS
            if len(self._kept) < MOST_SCANS and (early or stamp_ns - self._kept[-1].stamp_ns >= SCAN_APART_NS):
                self._kept.append(scan)
        self._scans.extend((self._seconds(stamp_ns), (beat_ns - stamp_ns) * 1e-9, returned, moved, near))

    def _lay(self, scan: Scan, estimate: Estimate | None) -> None:
        """Into the picture of the map, while the pose is believed."""
        if estimate is None or estimate.beam_verdicts is None or estimate.quality is Quality.LOST:
            return
        if self._cells.wants(scan.stamp_ns) and estimate.beam_verdicts.size == scan.ranges_m.size:
            beams, stamps_ns, laser_m = self._beams.of(scan)
            ranges_m, verdicts = scan.ranges_m[beams], estimate.beam_verdicts[beams]
            in_view = (self._view.range_min_m <= ranges_m) & (ranges_m < self._view.range_max_m)
            solid = in_view & (verdicts != BeamVerdict.MOVED)
            motion = Motion.between(self._before, estimate)
            points_m = motion.to_map(stamps_ns[solid], laser_m[solid], self._mount.as_pose())
            self._cells.take(scan.stamp_ns, points_m)

    def _has_scans_for_all_before(self, stamp_ns: int) -> bool:
        """Whether no scan will be kept any more that a sample of this time could be compared with."""
        return len(self._kept) == MOST_SCANS and stamp_ns > self._kept[-1].stamp_ns + AFTER_NS

    def _drive(self, name: str) -> DriveData | None:
        """What calibration can use; None where there are no scans or no wheels."""
        kinds = [tuple(samples) for samples in (self._samples, self._speeds, self._poses) if samples]
        if len(self._kept) < 2 or len(kinds) != 1 or len(kinds[0]) < 2:
            return None
        return DriveData(name, tuple(self._kept), kinds[0])  # type: ignore[arg-type]  # of one kind

    def _seconds(self, stamp_ns: int) -> float:
        assert self._origin_ns is not None  # set by the first tick
        return (stamp_ns - self._origin_ns) * 1e-9


def _known_map(reader: RunReader) -> LandmarkMap | None:
    """The saved map that the run began in; a review does without a copy that is gone."""
    if not reader.header.start:
        return None
    from runtime.map_files.start import recorded_start  # loads the filter with its compiler, 45 MB

    with suppress(NotAMapError):
        start = recorded_start(reader.header, reader.folder)
        return None if start is None else start.saved.joint.landmarks
    return None


def _table(figures: "array[float]", width: int) -> FloatArray:
    """Rows (n, width)."""
    return np.asarray(figures).reshape(-1, width)  # not copied, nor is a row taken any more


def _accuracy(ticks: TickColumns, origin_ns: int, inputs: RunReader, configuration: Configuration) -> dict[str, object]:
    """Figures against whatever truth there is, as `infant evaluate` gives them."""
    stamps_s = ticks.times_s + origin_ns * 1e-9
    known = np.isfinite(ticks.truth[:, 0])
    searched = searched_rows(ticks.counts)

    def rows(poses: FloatArray) -> FloatArray:
        return np.column_stack((stamps_s, poses))

    truth = rows(ticks.truth)[known] if known.any() else None
    estimated, odometry = rows(ticks.estimated)[searched:], rows(ticks.odometry)[searched:]
    trajectories = Trajectories(estimated, estimated, odometry, truth)
    if truth is not None:
        figures = against_simulation(trajectories)
    else:
        held = DataSetTruth.from_attachments(inputs.attachments)
        mount = configuration.slam.mount
        offset = (mount.x_m, mount.y_m, mount.yaw_rad)
        figures = {} if held is None else against_data_set(trajectories, held, offset)
    return {key: value for key, value in (nothing_known() | figures).items() if "particles" not in key}
