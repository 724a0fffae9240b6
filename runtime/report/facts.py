"""What a review is made from: one pass over a run leaves columns of numbers, its events, and scans to calibrate by."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import BoolArray, Event, FloatArray
from runtime.calibrate.drive_data import DriveData
from runtime.calibrate.result import Calibration
from runtime.calibrate.scans.orientation import AS_BELIEVED, Orientation
from runtime.evaluate.smoothed import SmoothedResult
from runtime.maps.scan_picture import ScanPicture
from runtime.messages.tick import Gap
from runtime.report.finding import Interval, intervals_where
from runtime.settings.configuration import Configuration
from slam.estimate import LandmarkMap

BEGINS_S = 0.15  # before the span of a doubt: the beat that began it
LIFTED_S = 1.0  # before a scan tells that a rover was carried: from the first push on, wheels and laser part
JOINED_S = 2.0  # between two spans without a pose: the same carrying
QUALITIES = ("tracking", "uncertain", "lost")
"""Names of the values in TickColumns.quality."""


@dataclass(frozen=True, slots=True, eq=False)
class TickColumns:
    """One row a tick; times_s counts from the first tick. NaN where nothing was recorded.

    estimated, odometry, truth (n, 3): x m, y m, heading rad; position_sd_m: larger axis of the published covariance;
    apart_m: joint Gaussian to particle mean; quality: index into QUALITIES; counts: figures of the estimate by name.
    """

    times_s: FloatArray
    estimated: FloatArray
    odometry: FloatArray
    truth: FloatArray
    position_sd_m: FloatArray
    apart_m: FloatArray
    quality: NDArray[np.int64]
    lateness_ms: FloatArray
    missed: FloatArray
    stages_ms: dict[str, FloatArray] = field(default_factory=dict)
    counts: dict[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class ScanColumns:
    """One row a scan: its stamp, how old it was at its beat, share of beams that came back; of those, the share that
    the front end refused because nothing was seen there before (also leaves and edges), and of those the near ones.
    """

    times_s: FloatArray
    age_s: FloatArray
    returned_share: FloatArray
    moved_share: FloatArray
    near_moved_share: FloatArray

    @property
    def are_sweeps(self) -> bool:
        """False where the sensor reports landmarks only when it sees some: then silence is no fault."""
        return bool(np.isfinite(self.returned_share).any()) or not self.times_s.size


@dataclass(frozen=True, slots=True, eq=False)
class WheelColumns:
    """One row a wheel sample, counts (n, 2) left and right; NaN for other kinds of odometry."""

    times_s: FloatArray
    counts: FloatArray
    valid: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class DeviceClock:
    """The laser's own counter against the host: arrival (n,) s of the host, device (n,) s, unwrapped; may be empty."""

    arrival_s: FloatArray
    device_s: FloatArray


@dataclass(frozen=True, slots=True)
class GeometryRow:
    """One parameter of the geometry in the page's unit: as configured, 95 % interval of this run alone (None where it
    cannot tell), and the least deviation that this run would have shown if nothing else had deviated.
    """

    label: str
    unit: str
    configured: float
    interval: tuple[float, float] | None
    detectable: float


@dataclass(frozen=True, slots=True)
class StuckEncoder:
    """side: "left" or "right"; intervals, s since the first tick, in which it counted nothing while the other wheel
    rolled other_rolled_m, and the laser saw no turn about it.
    """

    side: str
    other_rolled_m: float
    intervals: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True, eq=False)
class RunFacts:
    """All that findings and the page may look at. origin_ns: stamp of the first tick.

    imported: recorded by software of others, whose rates and gaps are the recording's own. defects: s since the first
    tick and reason of every step that raised. stuck_encoders, orientation (of the laser, against the configuration),
    calibration: what `calibrated` adds; None where `drive` has nothing to calibrate by. known_map: the saved map that
    the run began in, None where it began without. smoothed: what `infant smooth` made of these estimates, if it did.
    scan_picture: all scans in the map; None without scans. recording: the run has not ended.
    """

    name: str
    source: str
    created_utc: str
    configuration: Configuration
    versions: dict[str, str]
    origin_ns: int
    ticks: TickColumns
    scans: ScanColumns
    wheels: WheelColumns
    device_clock: DeviceClock
    events: tuple[Event, ...]
    gaps: tuple[Gap, ...]
    truncated: str
    landmarks: LandmarkMap | None
    drive: DriveData | None
    accuracy: dict[str, Any]
    imported: bool
    defects: tuple[tuple[float, str], ...] = ()
    stuck_encoders: tuple[StuckEncoder, ...] = ()
    orientation: Orientation = AS_BELIEVED
    calibration: Calibration | None = None
    known_map: LandmarkMap | None = None
    smoothed: SmoothedResult | None = None
    scan_picture: ScanPicture | None = None
    recording: bool = False

    @property
    def duration_s(self) -> float:
        """From the first tick to the last."""
        return float(self.ticks.times_s[-1]) if self.ticks.times_s.size else 0.0

    def seconds(self, stamp_ns: int) -> float:
        """A stamp as seconds since the first tick."""
        return (stamp_ns - self.origin_ns) * 1e-9

    def events_ever(self, source: str) -> list[Event]:
        """Events of a source, those before the first tick too: for what was never heard they are all that is known."""
        return [event for event in self.events if event.source == source]

    def events_of(self, source: str, *kinds: str) -> list[Event]:
        """Events of a source during the run, of these kinds if any are named.

        What happens while devices come up, before the first tick, is no finding.
        """
        return [
            event
            for event in self.events
            if event.source == source and (not kinds or event.kind in kinds) and event.stamp_ns >= self.origin_ns
        ]

    def began_with_one_scan(self, doubt: Interval) -> bool:
        """Whether a doubt of the pose began with one scan that fits nowhere near the one before.

        So it is where the rover was carried, pushed or lifted; landmarks that are missed need several.
        """
        score = self.ticks.counts.get("doubt_score")
        if score is None:
            return False
        told = np.isfinite(score)
        begun = int(np.searchsorted(self.ticks.times_s[told], doubt[0] - BEGINS_S))
        steps = np.diff(score[told][max(0, begun - 1) : begun + 2])
        return bool((steps >= self.configuration.slam.quality.lost_score).any())

    def carried_spans(self) -> tuple[Interval, ...]:
        """From when it was lifted until its place was known again, s: its wheels say nothing of the ground then."""
        lost = self.ticks.quality == QUALITIES.index("lost")
        spans = intervals_where(self.ticks.times_s, lost, JOINED_S)
        return tuple((start - LIFTED_S, end) for start, end in spans if self.began_with_one_scan((start, end)))
