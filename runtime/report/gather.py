"""The one pass over a run that leaves RunFacts."""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from drivers.measurements import Event, FloatArray, OdometryPose, Scan, SpeedSteering, WheelCounts
from runtime.calibrate.drive_data import DriveData
from runtime.errors import NotAMapError, UsageError
from runtime.evaluate.evaluate import against_data_set, against_simulation, nothing_known
from runtime.evaluate.smoothed import read_smoothed
from runtime.evaluate.truth import DataSetTruth
from runtime.map_files.start import recorded_start
from runtime.maps.placed_scans import at_scan, place, twist_between
from runtime.maps.scan_picture import ScanCells
from runtime.messages.decoding import decoded
from runtime.printable import printable
from runtime.record.reader import RecordedTick, RunReader
from runtime.record.room import is_being_written
from runtime.record.trajectories import Trajectories, with_estimates
from runtime.report.device_clock import DeviceClockReader
from runtime.report.facts import QUALITIES, RunFacts, ScanColumns, TickColumns, WheelColumns
from runtime.settings.configuration import Configuration, load_configuration_text
from runtime.tick import of_its_time
from slam.estimate import Estimate, LandmarkMap, Quality
from slam.observations import BeamVerdict
from slam.settings.slam import SlamSettings

REST_SCANS = 20  # the first scans, all of them: they stand still and show the range noise
SCAN_APART_NS = 240_000_000  # then one in 0.25 s suffices for matching and costs a third
NEAR_M = 6.0  # who walks along is within; bushes and walls, whose edges come and go, are farther from the course
MOST_SCANS = 1200  # five minutes of driving show 0.4 % of a wheel; 10 MB, and half of the time of a review


def gather(run: Path) -> RunFacts:
    """Facts of a run; of the newest replay inside it if the run was imported.

    Raises NotARunError, ConfigurationError; UsageError where there are no estimates yet.
    """
    inputs = RunReader(run)
    reader = with_estimates(inputs)
    configuration = load_configuration_text(reader.header.configuration_text, source=f"configuration of {run}")
    pass_ = Gathering(configuration.slam)
    for recorded in reader.ticks():
        pass_.take(recorded)
    if not pass_.rows:
        if not pass_.ticks:
            why = f": {reader.truncated}" if reader.truncated else ""
            raise UsageError(
                f"{reader.folder.path} holds not a single complete tick, so there is nothing to review{why}"
            )
        raise UsageError(f"{reader.folder.path} holds no estimates; replay it first: infant replay {run}")
    clock = DeviceClockReader()
    for record in reader.records():
        if record.topic == "/raw/laser":
            decoded(record, lambda _: clock.feed(record), reader.place)  # noqa: B023 called at once
    return pass_.facts(reader, inputs, configuration, clock)


class Gathering:
    """Rows that grow tick by tick; only numbers stay, and some scans."""

    def __init__(self, settings: SlamSettings) -> None:
        self._settings = settings
        self._mount = settings.mount
        self._before: Estimate | None = None
        self._cells = ScanCells()
        self.rows: list[tuple[float, ...]] = []
        self.ticks = 0
        self._counts: list[dict[str, float]] = []
        self._stages: list[dict[str, int]] = []
        self._scans: list[tuple[float, ...]] = []
        self._wheels: list[tuple[float, float, float, bool]] = []
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
            if isinstance(sample, WheelCounts):
                self._wheels.append((self._seconds(sample.stamp_ns), sample.left, sample.right, sample.valid))
                self._samples.append(sample)
                continue
            self._wheels.append((self._seconds(sample.stamp_ns), math.nan, math.nan, True))
            if isinstance(sample, SpeedSteering):
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
        nowhere = np.full(3, np.nan)
        self.rows.append(
            (
                self._seconds(tick.stamp_ns),
                *estimate.map_from_body.as_array(),
                *estimate.odom_from_body.as_array(),
                *(nowhere if truth is None else truth.as_array()),
                math.sqrt(
                    max(0.0, float(np.linalg.eigvalsh(np.nan_to_num(estimate.covariance[:2, :2], nan=1e12))[-1]))
                ),
                math.dist(estimate.map_from_body.as_array()[:2], estimate.particle_mean.as_array()[:2]),
                QUALITIES.index(estimate.quality.value),
                math.nan if timing is None else timing.lateness_ns * 1e-6,
                0.0 if timing is None else timing.missed,
            )
        )
        self._before = estimate
        self._counts.append(estimate.counts)
        self._stages.append({} if timing is None else timing.stages_ns)

    def facts(
        self, reader: RunReader, inputs: RunReader, configuration: Configuration, clock: DeviceClockReader
    ) -> RunFacts:
        """Everything as columns. reader: of the estimates; inputs: of the run, the same unless it was imported."""
        name = printable(inputs.folder.path.name)
        rows = np.array(self.rows)
        ticks = TickColumns(
            rows[:, 0],
            rows[:, 1:4],
            rows[:, 4:7],
            rows[:, 7:10],
            rows[:, 10],
            rows[:, 11],
            rows[:, 12].astype(np.int64),
            rows[:, 13],
            rows[:, 14],
            {key: values * 1e-6 for key, values in _columns(self._stages).items()},
            _columns(self._counts),
        )
        scans = np.array(self._scans).reshape(-1, 5)
        wheels = np.array([row[:3] for row in self._wheels]).reshape(-1, 3)
        valid = np.array([row[3] for row in self._wheels], dtype=np.bool_)
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
            wheels=WheelColumns(wheels[:, 0], wheels[:, 1:], valid),
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
            self._lay(scan, estimate)
            scan = self._mount.upright(scan)
            back = np.isfinite(scan.ranges_m) & (scan.ranges_m < scan.range_max_m)
            returned = float(back.mean())
            if estimate is not None and estimate.beam_verdicts is not None:
                refused = (estimate.beam_verdicts == BeamVerdict.MOVED) & back
                moved = float(refused.sum()) / max(1, int(back.sum()))
                near = float((refused & (scan.ranges_m < NEAR_M)).sum()) / max(1, int(back.sum()))
            early = len(self._kept) < REST_SCANS
            if len(self._kept) < MOST_SCANS and (early or stamp_ns - self._kept[-1].stamp_ns >= SCAN_APART_NS):
                self._kept.append(scan)
        self._scans.append((self._seconds(stamp_ns), (beat_ns - stamp_ns) * 1e-9, returned, moved, near))

    def _lay(self, scan: Scan, estimate: Estimate | None) -> None:
        """Into the picture of the map, while the pose is believed."""
        if estimate is None or estimate.beam_verdicts is None or estimate.quality is Quality.LOST:
            return
        if self._cells.wants(scan.stamp_ns):
            pose, twist = at_scan(scan.stamp_ns, self._before, estimate), twist_between(self._before, estimate)
            placed = place(scan, pose, twist, estimate.beam_verdicts, self._settings)
            self._cells.take(scan.stamp_ns, placed.points_m[placed.solid])

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
    with suppress(NotAMapError):
        start = recorded_start(reader.header, reader.folder)
        return None if start is None else start.saved.joint.landmarks
    return None


def _columns(rows: Sequence[Mapping[str, float]]) -> dict[str, FloatArray]:
    """Figures by name, (n,) each; NaN where a row has no such figure."""
    columns: dict[str, FloatArray] = defaultdict(lambda: np.full(len(rows), np.nan))
    for index, row in enumerate(rows):
        for key, value in row.items():
            columns[key][index] = value
    return dict(columns)


def _accuracy(ticks: TickColumns, origin_ns: int, inputs: RunReader, configuration: Configuration) -> dict[str, object]:
    """Figures against whatever truth there is, as `infant evaluate` gives them."""
    stamps_s = ticks.times_s + origin_ns * 1e-9
    known = np.isfinite(ticks.truth[:, 0])

    def rows(poses: FloatArray) -> FloatArray:
        return np.column_stack((stamps_s, poses))

    truth = rows(ticks.truth)[known] if known.any() else None
    trajectories = Trajectories(rows(ticks.estimated), rows(ticks.estimated), rows(ticks.odometry), truth)
    if truth is not None:
        figures = against_simulation(trajectories)
    else:
        held = DataSetTruth.from_attachments(inputs.attachments)
        mount = configuration.slam.mount
        offset = (mount.x_m, mount.y_m, mount.yaw_rad)
        figures = {} if held is None else against_data_set(trajectories, held, offset)
    return {key: value for key, value in (nothing_known() | figures).items() if "particles" not in key}
