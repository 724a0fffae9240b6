"""What the sensors measured: immutable values in SI units, and the seams that deliver them.

Stamps are integers of host monotonic nanoseconds. Arrays are read-only.
"""

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
RangeArray = NDArray[np.float32]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
VerdictArray = NDArray[np.uint8]  # a verdict for each beam or feature

LARGEST_SPAN_RAD = 4.0 * math.pi  # of one sweep: no laser looks twice round; in degrees every one would


class DriverError(Exception):
    """Base of everything a driver raises; the message is one sentence that says what to do."""


class LinkError(DriverError):
    """A port, socket or bus cannot be opened or has gone away; trying again can help."""


class ProtocolError(DriverError):
    """The other end sent bytes that are not a valid message of its protocol."""


class DeviceError(DriverError):
    """The device answered that it cannot do what was asked, or reports a fault of its own."""


def uniform_bearings(angle_min_rad: float, angle_increment_rad: float, count: int) -> FloatArray:
    """Bearings of equally spaced beams, shape (count,): the one formula that record and drivers share."""
    bearings = angle_min_rad + angle_increment_rad * np.arange(count, dtype=np.float64)
    bearings.setflags(write=False)
    return bearings


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One sweep of the laser, in the laser's frame (x forward, y left).

    stamp_ns: time at which beam `stamp_beam` was measured.
    ranges_m: (N,) float32; NaN where nothing valid came back.
    bearings_rad: (N,) float64, counter-clockwise, 0 straight ahead.
    beam_period_s: time from one beam to the next (0: all at once; negative: the last beam comes first); beam k was
        taken at stamp + (k - stamp_beam) * beam_period_s.
    """

    stamp_ns: int
    ranges_m: RangeArray
    bearings_rad: FloatArray
    beam_period_s: float = 0.0
    stamp_beam: int = 0
    range_max_m: float = 60.0

    def __post_init__(self) -> None:
        if self.ranges_m.shape != self.bearings_rad.shape or self.ranges_m.ndim != 1:
            raise ValueError(f"{self.ranges_m.shape=} but {self.bearings_rad.shape=}")
        self.ranges_m.setflags(write=False)
        self.bearings_rad.setflags(write=False)

    def mirrored(self) -> "Scan":
        """Left and right exchanged: a laser that hangs upside down as if it stood. Beams stay counter-clockwise."""
        return Scan(
            self.stamp_ns,
            self.ranges_m[::-1].copy(),
            -self.bearings_rad[::-1].copy(),
            -self.beam_period_s,
            self.ranges_m.size - 1 - self.stamp_beam,
            self.range_max_m,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Range and bearing to things that a sensor already tells apart, in the sensor's frame.

    Takes the place of a Scan for data sets of coded landmarks and for worlds at feature level.
    identities: (K,) int64; -1 where the sensor does not know which thing it saw.
    """

    stamp_ns: int
    ranges_m: FloatArray
    bearings_rad: FloatArray
    identities: IntArray

    def __post_init__(self) -> None:
        for array in (self.ranges_m, self.bearings_rad, self.identities):
            if array.shape != self.ranges_m.shape or array.ndim != 1:
                raise ValueError(f"{array.shape=} but {self.ranges_m.shape=}")
            array.setflags(write=False)

    def mirrored(self) -> "Sightings":
        """Left and right exchanged, as for a Scan."""
        return replace(self, bearings_rad=-self.bearings_rad)


@dataclass(frozen=True, slots=True)
class WheelCounts:
    """Totals of both encoders at one instant: unwrapped, forward positive, both interpolated to stamp_ns.

    Floats, because interpolation between frames falls between counts. `valid` is False where a wheel was
    silent or refused: motion since the last valid sample is then unknown, not zero. `unbroken` is True on the first
    valid sample after invalid ones where the counters went on meanwhile: the difference from the last valid sample
    is the motion of the whole gap.
    """

    stamp_ns: int
    left: float
    right: float
    valid: bool = True
    unbroken: bool = False


@dataclass(frozen=True, slots=True)
class SpeedSteering:
    """Speed of the measured wheel and angle of the steered axle (positive left), held until the next sample."""

    stamp_ns: int
    speed_mps: float
    steering_rad: float


@dataclass(frozen=True, slots=True)
class SpeedYawRate:
    """Forward speed and yaw rate, held until the next sample."""

    stamp_ns: int
    speed_mps: float
    yaw_rate_radps: float


@dataclass(frozen=True, slots=True)
class OdometryPose:
    """Pose in the odometry frame as a base without accessible wheels reports it."""

    stamp_ns: int
    x_m: float
    y_m: float
    heading_rad: float


WheelSample = WheelCounts | SpeedSteering | SpeedYawRate | OdometryPose
ScanLike = Scan | Sightings


class Severity(StrEnum):
    """How bad an event is."""

    INFO = "info"
    WARN = "warn"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened to a part of the system, kept in the log with its reason.

    source: "laser", "encoders", "loop", "record", ...; kind: a short stable word such as "reconnect",
    "checksum", "stale"; reason: one plain sentence.
    """

    stamp_ns: int
    source: str
    kind: str
    reason: str
    severity: Severity = Severity.INFO


class SensorState(StrEnum):
    """Freshness of one input."""

    STARTING = "starting"
    FRESH = "fresh"
    STALE = "stale"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class SensorHealth:
    """State of one sensor for the health record; counters by reason, figures by name with unit in the name."""

    state: SensorState
    reason: str
    rate_hz: float
    counters: dict[str, int] = field(default_factory=dict)
    figures: dict[str, float] = field(default_factory=dict)
    facts: dict[str, str] = field(default_factory=dict)


class RawTap(Protocol):
    """Receives every byte that crosses a wire, for the record; called from reader threads, never blocks."""

    def laser_bytes(self, stamp_ns: int, sent: bool, data: bytes) -> None:
        """Bytes of the laser link; sent is True from host to device."""

    def can_frame(self, stamp_ns: int, arbitration_id: int, flags: int, data: bytes) -> None:
        """One CAN frame; flags: 1 extended, 2 remote, 4 error, 8 FD."""


class Laser(Protocol):
    """The laser as the loop sees it; no method blocks, trouble is a state and never an exception."""

    def start(self) -> None:
        """Begin connecting in a thread of the driver's own."""

    def latest(self) -> Scan | None:
        """Newest scan not handed out yet, None if there is none."""

    def drain_events(self) -> tuple[Event, ...]:
        """Events since the last call."""

    def health(self) -> SensorHealth:
        """State now."""

    def close(self) -> None:
        """Stop the device and the thread; at most 2 s."""


class Encoders(Protocol):
    """The wheel encoders as the loop sees them; same rules as Laser."""

    def start(self) -> None:
        """Begin reading in a thread of the driver's own."""

    def drain(self) -> tuple[WheelCounts, ...]:
        """All samples since the last call, oldest first."""

    def drain_events(self) -> tuple[Event, ...]:
        """Events since the last call."""

    def health(self) -> SensorHealth:
        """State now."""

    def close(self) -> None:
        """Stop the thread and leave the bus; at most 2 s."""
