"""What a run's messages mean: Tick and its companions to bytes and back, to the last bit.

Both directions of each message stand beside each other; /scan stands in ros.py because other tools read it.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import (
    LARGEST_SPAN_RAD,
    Event,
    FloatArray,
    Scan,
    ScanLike,
    Severity,
    Sightings,
    uniform_bearings,
)
from runtime.messages.believed import pose_of, stamp_of
from runtime.messages.definitions import TYPES, construct, deserialize, serialize
from runtime.messages.wheels import wheel_columns, wheel_samples
from runtime.tick import Tick, Timing
from slam.pose import Pose2

NOTHING, SCAN, SIGHTINGS = 0, 1, 2
EMPTY: FloatArray = np.empty(0)
FARTHEST_M, LONGEST_BEAM_S = 1e6, 1.0  # far beyond any laser; a NaN is beyond both


@dataclass(frozen=True, slots=True)
class Record:
    """One message as it stands in run.mcap: the topic names its type (definitions.TYPES)."""

    topic: str
    stamp_ns: int
    data: bytes


def encode(topic: str, stamp_ns: int, /, **fields: Any) -> Record:
    """A record of the topic's type."""
    name = TYPES[topic]
    return Record(topic, stamp_ns, serialize(name, construct(name, **fields)))


def decode(topic: str, data: bytes) -> Any:
    """The message of a topic as rosbags gives it; the functions below make our own values of it."""
    return deserialize(TYPES[topic], data)


def encode_tick(tick: Tick) -> Record:
    """All of the tick but the ranges of a Scan, which the LaserScan on /scan holds (see ros.encode_scan)."""
    kinds, stamps_ns, values = wheel_columns(tick.wheels)
    return encode(
        "/tick",
        tick.stamp_ns,
        seq=tick.seq,
        stamp_ns=tick.stamp_ns,
        **_seen_fields(tick.scan),
        wheel_kinds=kinds,
        wheel_stamps_ns=stamps_ns,
        wheel_values=values,
        event_stamps_ns=np.array([event.stamp_ns for event in tick.events], np.int64),
        event_sources=[event.source for event in tick.events],
        event_kinds=[event.kind for event in tick.events],
        event_reasons=[event.reason for event in tick.events],
        event_severities=[event.severity.value for event in tick.events],
    )


def decode_tick(data: bytes, ranges_m: NDArray[np.float32] | None = None) -> Tick:
    """The tick; ranges_m (N,) are those of the LaserScan that stands before it, if it has seen a scan.

    Its arrays are copies: views into a message stand off their natural alignment, and compiled kernels would be
    compiled a second time for them, with other instructions than on the drive.

    Raises ValueError when the scan's ranges are missing, or its beams are those of no laser.
    """
    message = decode("/tick", data)
    wheels = wheel_samples(message.wheel_kinds, message.wheel_stamps_ns, message.wheel_values)
    return Tick(message.seq, stamp_of(message.stamp_ns), _seen(message, ranges_m), wheels, _events(message))


def encode_timing(seq: int, stamp_ns: int, timing: Timing) -> Record:
    """How the loop kept time on this tick."""
    return encode(
        "/timing",
        stamp_ns,
        seq=seq,
        stamp_ns=stamp_ns,
        lateness_ns=timing.lateness_ns,
        missed=timing.missed,
        stage_names=list(timing.stages_ns),
        stage_durations_ns=np.array(list(timing.stages_ns.values()), np.int64),
    )


def decode_timing(data: bytes) -> Timing:
    """Back again."""
    message = decode("/timing", data)
    stages_ns = dict(zip(message.stage_names, message.stage_durations_ns.tolist(), strict=True))
    return Timing(message.lateness_ns, message.missed, stages_ns)


def encode_state_hash(seq: int, stamp_ns: int, state_hash: bytes) -> Record:
    """Hash of the filter's state after this tick."""
    return encode("/state_hash", stamp_ns, seq=seq, stamp_ns=stamp_ns, state_hash=np.frombuffer(state_hash, np.uint8))


def decode_state_hash(data: bytes) -> bytes:
    """Back again."""
    state_hash: bytes = decode("/state_hash", data).state_hash.tobytes()
    return state_hash


def encode_truth(stamp_ns: int, map_from_body: Pose2) -> Record:
    """Where a simulated rover really was."""
    return encode("/truth", stamp_ns, stamp_ns=stamp_ns, map_from_body=map_from_body.as_array())


def decode_truth(data: bytes) -> Pose2:
    """Back again."""
    return pose_of(decode("/truth", data).map_from_body)


def encode_defect(stamp_ns: int, reason: str) -> Record:
    """A step that raised, in one sentence."""
    return encode("/defect", stamp_ns, stamp_ns=stamp_ns, reason=reason)


def decode_defect(data: bytes) -> str:
    """Back again."""
    return str(decode("/defect", data).reason)


@dataclass(frozen=True, slots=True)
class Gap:
    """The record lost this many ticks and raw messages before this stamp."""

    stamp_ns: int
    ticks: int
    raw: int
    reason: str


def encode_gap(gap: Gap) -> Record:
    """What the record has lost."""
    return encode("/gap", gap.stamp_ns, stamp_ns=gap.stamp_ns, ticks=gap.ticks, raw=gap.raw, reason=gap.reason)


def decode_gap(data: bytes) -> Gap:
    """Back again."""
    message = decode("/gap", data)
    return Gap(message.stamp_ns, message.ticks, message.raw, message.reason)


@dataclass(frozen=True, slots=True)
class LaserBytes:
    """Bytes of the laser's wire; sent is True from host to device."""

    stamp_ns: int
    sent: bool
    data: bytes


def encode_laser_bytes(raw: LaserBytes) -> Record:
    """Raw bytes of the laser."""
    data = np.frombuffer(raw.data, np.uint8)
    return encode("/raw/laser", raw.stamp_ns, stamp_ns=raw.stamp_ns, sent=raw.sent, data=data)


def decode_laser_bytes(data: bytes) -> LaserBytes:
    """Back again."""
    message = decode("/raw/laser", data)
    return LaserBytes(message.stamp_ns, message.sent, message.data.tobytes())


def _seen_fields(seen: ScanLike | None) -> dict[str, Any]:
    """The fields of Tick that tell what was seen."""
    fields: dict[str, Any] = {
        "seen": NOTHING,
        "seen_stamp_ns": 0,
        "beam_period_s": 0.0,
        "stamp_beam": 0,
        "range_max_m": 0.0,
        "bearing_first_rad": 0.0,
        "bearing_increment_rad": 0.0,
        "bearings_rad": EMPTY,
        "sighting_ranges_m": EMPTY,
        "sighting_bearings_rad": EMPTY,
        "sighting_identities": np.empty(0, np.int64),
    }
    match seen:
        case Scan():
            increment_rad = exact_increment_rad(seen.bearings_rad)
            fields |= {
                "seen": SCAN,
                "seen_stamp_ns": seen.stamp_ns,
                "beam_period_s": seen.beam_period_s,
                "stamp_beam": seen.stamp_beam,
                "range_max_m": seen.range_max_m,
            }
            if increment_rad is None:
                fields["bearings_rad"] = seen.bearings_rad
            else:
                fields["bearing_first_rad"] = float(seen.bearings_rad[0])
                fields["bearing_increment_rad"] = increment_rad
        case Sightings():
            fields |= {
                "seen": SIGHTINGS,
                "seen_stamp_ns": seen.stamp_ns,
                "sighting_ranges_m": seen.ranges_m,
                "sighting_bearings_rad": seen.bearings_rad,
                "sighting_identities": seen.identities,
            }
    return fields


def _seen(message: Any, ranges_m: NDArray[np.float32] | None) -> ScanLike | None:
    if message.seen == SIGHTINGS:
        return Sightings(
            message.seen_stamp_ns,
            message.sighting_ranges_m.copy(),
            message.sighting_bearings_rad.copy(),
            message.sighting_identities.copy(),
        )
    if message.seen != SCAN:
        return None
    if ranges_m is None:
        raise ValueError(f"tick {message.seq} used a scan, but there is no LaserScan before it")
    bearings_rad = message.bearings_rad.copy()
    if bearings_rad.size == 0:
        bearings_rad = _bearings(message.bearing_first_rad, message.bearing_increment_rad, ranges_m.size)
    else:
        _check_bearings(bearings_rad)
    for name, figure, least, most in (
        ("range_max_m", message.range_max_m, 0.0, FARTHEST_M),
        ("beam_period_s", message.beam_period_s, -LONGEST_BEAM_S, LONGEST_BEAM_S),
        ("stamp_beam", message.stamp_beam, 0, max(0, ranges_m.size - 1)),
    ):
        if not least <= figure <= most:
            raise ValueError(f"{name} is {figure:g}, expected {least:g} to {most:g}")
    stamp_ns = stamp_of(message.seen_stamp_ns)
    return Scan(stamp_ns, ranges_m, bearings_rad, message.beam_period_s, message.stamp_beam, message.range_max_m)


@lru_cache(maxsize=8)
def _bearings(first_rad: float, increment_rad: float, count: int) -> FloatArray:
    """The same array for every scan of a laser, as the driver has it. Raises ValueError."""
    with np.errstate(invalid="ignore", over="ignore"):
        bearings_rad = uniform_bearings(first_rad, increment_rad, count)
    _check_bearings(bearings_rad)
    return bearings_rad


def _check_bearings(bearings_rad: FloatArray) -> None:
    """Raises ValueError where they are not counter-clockwise within two turns; false for NaN and infinity."""
    if bearings_rad.size and not (
        abs(bearings_rad[0]) <= LARGEST_SPAN_RAD
        and bearings_rad[-1] - bearings_rad[0] < LARGEST_SPAN_RAD
        and (bearings_rad[1:] > bearings_rad[:-1]).all()
    ):
        raise ValueError("its bearings are not those of one sweep, counter-clockwise in radians")


def exact_increment_rad(bearings_rad: FloatArray) -> float | None:
    """The increment with which uniform_bearings gives exactly these bearings (N,), None if there is none.

    The last bearing carries the increment to a fraction of its last bit, so that three candidates suffice.
    """
    if bearings_rad.size == 0 or (bearings_rad[0] == 0.0 and np.signbit(bearings_rad[0])):
        return None  # minus zero would be taken for zero where bearings are kept for the next scan
    if bearings_rad.size == 1:
        return 0.0
    guess = (bearings_rad[-1] - bearings_rad[0]) / (bearings_rad.size - 1)
    for candidate in (guess, np.nextafter(guess, np.inf), np.nextafter(guess, -np.inf)):
        again_rad = uniform_bearings(float(bearings_rad[0]), float(candidate), bearings_rad.size)
        if again_rad.tobytes() == bearings_rad.tobytes():
            return float(candidate)
    return None


def _events(message: Any) -> tuple[Event, ...]:
    return tuple(
        Event(stamp_ns, source, kind, reason, Severity(severity))
        for stamp_ns, source, kind, reason, severity in zip(
            message.event_stamps_ns.tolist(),
            message.event_sources,
            message.event_kinds,
            message.event_reasons,
            message.event_severities,
            strict=True,
        )
    )
