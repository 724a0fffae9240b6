"""Short simulated runs without processes, each with one fault that the review has to name."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from drivers.measurements import Event, Scan, Severity, WheelCounts, uniform_bearings
from drivers.scip.scan import encode_scan
from drivers.settings.simulated_world import DriveSettings, LaserGeometrySettings, WorldSettings
from drivers.simulated.world.places.world import World
from runtime.messages.records import tick_records
from runtime.messages.tick import Gap, LaserBytes, Record, encode_gap, encode_laser_bytes
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RunWriter
from runtime.report.facts import RunFacts
from runtime.report.gather import gather
from runtime.report.wheel_calibration import calibrated
from runtime.settings.configuration import Configuration
from runtime.tick import CompletedTick, Tick, Timing
from slam.estimator import Estimator
from slam.pose import Pose2
from slam.settings.slam import MountSettings, SlamSettings
from tests.support.runtime.made_drives import BOOT_NS, Rover, counted, wheel_counts

BEAT_S = 0.1
SWEEP_LEAD_S = 0.09  # the sweep of a beat begins this long before it
WHEEL_DELAY_S = 0.01


@dataclass(slots=True)
class Draft:
    """One beat before it is written."""

    seq: int
    scan: Scan | None
    wheels: tuple[WheelCounts, ...]
    events: tuple[Event, ...] = ()
    missed: int = 0
    lost: int = 0
    kept: bool = True
    raw: tuple[Record, ...] = ()

    @property
    def stamp_ns(self) -> int:
        """Of the beat."""
        return BOOT_NS + round(self.seq * BEAT_S * 1e9)


Fault = Callable[[list[Draft], np.random.Generator], list[Draft]]


@cache
def sweeps(
    seed: int, mount: tuple[float, float, float], tread_m: float, duration_s: float, people: int = 7
) -> tuple[World, list[Scan]]:
    """The world and one sweep a beat."""
    laser = LaserGeometrySettings(body_from_laser=mount)
    world = World(WorldSettings(seed=seed, people=people, drive=DriveSettings(tread_m=tread_m), laser=laser))
    bearings = uniform_bearings(laser.first_bearing_rad, laser.beam_spacing_rad, laser.beam_count)
    scans = []
    for seq in range(1, round(duration_s / BEAT_S)):
        t_ns = round((seq * BEAT_S - SWEEP_LEAD_S) * 1e9)
        ranges = world.ranges_at(t_ns).astype(np.float32)
        ranges[~np.isfinite(ranges)] = np.nan
        scans.append(Scan(BOOT_NS + t_ns, ranges, bearings, laser.beam_period_s, 0, laser.range_max_m))
    return world, scans


def seeded_facts(
    folder: Path,
    seed: int,
    rover: Rover | None = None,
    fault: Fault | None = None,
    duration_s: float = 30.0,
    people: int = 7,
) -> RunFacts:
    """Write a run into `folder`, as a live one would be, and gather its facts."""
    rover = rover or Rover()
    rng = np.random.default_rng([seed, 99])
    world, scans = sweeps(seed, rover.mount, rover.tread_m, duration_s, people)
    drafts = _drafts(world, scans, rover, rng, duration_s)
    if fault is not None:
        drafts = fault(drafts, rng)
    slam = SlamSettings(particles=10, mount=MountSettings(x_m=0.3))
    configuration = Configuration(slam=slam, seed=seed)
    folder.mkdir(parents=True, exist_ok=True)
    header = RunHeader(configuration.text, "live", created_utc="2026-01-01T00:00:00Z")
    writer = RunWriter(folder / "run.mcap", header.metadata)
    estimator = Estimator(configuration.slam, configuration.seed)
    for draft in drafts:
        tick = Tick(draft.seq, draft.stamp_ns, draft.scan, draft.wheels, draft.events)
        estimate = estimator.step(tick.stamp_ns, tick.scan, draft.wheels)
        truth = Pose2(*world.map_from_body(tick.stamp_ns - BOOT_NS))
        timing = Timing(60_000, draft.missed, {"read": 40_000, "step": 5_000_000})
        records = tick_records(CompletedTick(tick, estimate, timing, estimator.state_hash(), truth))
        if draft.lost:
            records = [encode_gap(Gap(tick.stamp_ns, draft.lost, 0, "the disk was full")), *records]
        if draft.kept:
            writer.add([*records, *draft.raw])
    writer.close()
    return calibrated(gather(folder))


def _drafts(world: World, scans: list[Scan], rover: Rover, rng: np.random.Generator, duration_s: float) -> list[Draft]:
    times_s = np.arange(0.0, duration_s, 0.02)
    travel = np.array([world.wheel_travel_m(round(time * 1e9)) for time in times_s])
    samples = wheel_counts(times_s, counted(travel, rover, rng))
    late_ns = round(rover.latency_s * 1e9)
    beats = np.floor((times_s + WHEEL_DELAY_S) / BEAT_S).astype(int) + 1
    drafts = []
    for seq in range(round(duration_s / BEAT_S)):
        scan = replace(scans[seq - 1], stamp_ns=scans[seq - 1].stamp_ns + late_ns) if seq else None
        low, high = np.searchsorted(beats, (seq, seq + 1))
        drafts.append(Draft(seq, scan, samples[low:high]))
    return drafts


def at(draft: Draft, source: str, kind: str, reason: str, severity: Severity = Severity.WARN) -> Event:
    """An event as the drivers tell it."""
    return Event(draft.stamp_ns, source, kind, reason, severity)


def between(draft: Draft, start_s: float, end_s: float) -> bool:
    """Whether the beat falls into these seconds."""
    return start_s <= draft.seq * BEAT_S < end_s


def laser_silent(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """Nothing for 2 s."""
    start = rng.uniform(8.0, 20.0)
    return [replace(d, scan=None) if between(d, start, start + 2.0) else d for d in drafts]


def odometry_silent(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """No wheel sample for 1.3 s."""
    start = rng.uniform(8.0, 20.0)
    return [replace(d, wheels=()) if between(d, start, start + 1.3) else d for d in drafts]


def wheel_silent(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """The left node's frames stay away; the driver says that motion is unknown."""
    start, result = rng.uniform(8.0, 20.0), []
    for draft in drafts:
        if between(draft, start, start + 2.0):
            event = at(draft, "encoders", "invalid", "left wheel: silent: no good frame for 0.2 s")
            draft = replace(draft, wheels=tuple(replace(s, valid=False) for s in draft.wheels), events=(event,))
        result.append(draft)
    return result


def wheel_stuck(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """The right encoder's count stands for 5 s."""
    start, held, result = rng.uniform(8.0, 20.0), 0.0, []
    for draft in drafts:
        if between(draft, start, start + 5.0):
            draft = replace(draft, wheels=tuple(replace(s, right=held) for s in draft.wheels))
        elif draft.wheels and draft.seq * BEAT_S < start:
            held = draft.wheels[-1].right
        result.append(draft)
    return result


def laser_restarted(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """The clock begins anew: an event, and 0.4 s without a scan."""
    start, result, told = rng.uniform(8.0, 20.0), [], False
    for draft in drafts:
        if between(draft, start, start + 0.4):
            event = at(draft, "laser", "clock_restarts", "the laser's clock began anew")
            draft = replace(draft, scan=None, events=() if told else (event,))
            told = True
        result.append(draft)
    return result


def checksum_errors(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """Every second scan is damaged for 6 s, told once a second."""
    start, result = rng.uniform(8.0, 20.0), []
    for draft in drafts:
        if between(draft, start, start + 6.0) and rng.random() < 0.5:
            event = at(draft, "laser", "checksum_errors", "scan dropped: line 3 has the wrong check sum")
            draft = replace(draft, scan=None, events=(event,) if draft.seq % 10 < 2 else ())
        result.append(draft)
    return result


def rate_low(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """Every third scan only."""
    first = int(rng.integers(3))
    return [draft if draft.seq % 3 == first else replace(draft, scan=None) for draft in drafts]


def missed_beats(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """Three times two beats are overslept."""
    holes = sorted(rng.choice(np.arange(40, len(drafts) - 10, 7), 3, replace=False).tolist())
    result = []
    for draft in drafts:
        if any(hole <= draft.seq < hole + 2 for hole in holes):
            continue
        result.append(replace(draft, missed=2) if draft.seq - 2 in holes else draft)
    return result


def storage_gap(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """The record lost ten ticks; the filter had them."""
    hole = int(rng.integers(80, len(drafts) - 50))
    return [replace(d, lost=10 if d.seq == hole + 10 else 0, kept=not hole <= d.seq < hole + 10) for d in drafts]


def laser_late(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """From a moment on every scan comes 0.3 s late."""
    start, scans = int(rng.integers(60, 150)), [draft.scan for draft in drafts]
    return [d if d.seq <= start else replace(d, scan=None if d.seq <= start + 3 else scans[d.seq - 3]) for d in drafts]


def clock_drift(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """The laser's counter gains 1500 ppm, with some milliseconds of jitter in arrival."""
    result = []
    for draft in drafts:
        counter = round(draft.seq * 100.0 * 1.0015) + 5000
        arrival_ns = draft.stamp_ns + round(rng.exponential(2e6))
        head = encode_scan(b"MD0000108001000", "99", counter, b"0" * 8)
        result.append(replace(draft, raw=(encode_laser_bytes(LaserBytes(arrival_ns, False, head)),)))
    return result


def wheel_crc(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """A third of the left wheel's frames are damaged, told once a second."""
    start = float(rng.uniform(5.0, 10.0))
    text = "left wheel: checksums are wrong; check cable and termination, and that no other node uses this id"
    return [
        replace(d, events=(at(d, "encoders", "crc", text),)) if d.seq % 10 == 0 and between(d, start, 25.0) else d
        for d in drafts
    ]


def jump(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """The left node restarts once."""
    when = int(rng.integers(80, len(drafts) - 50))
    text = "left wheel: the node has booted"
    return [replace(d, events=(at(d, "encoders", "restart", text),)) if d.seq == when else d for d in drafts]


def blind(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """No scan for 4 s: the pose cannot be sure any more."""
    start = rng.uniform(8.0, 20.0)
    return [replace(d, scan=None) if between(d, start, start + 4.0) else d for d in drafts]


def upside_down(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """The laser hangs under the rover."""
    return [replace(d, scan=d.scan.mirrored() if d.scan is not None else None) for d in drafts]


def backwards(drafts: list[Draft], rng: np.random.Generator) -> list[Draft]:
    """The laser looks behind the rover: its bearings begin half a turn further."""

    def turned(scan: Scan) -> Scan:
        return replace(scan, bearings_rad=scan.bearings_rad + np.pi)

    return [replace(d, scan=turned(d.scan) if d.scan is not None else None) for d in drafts]


FAULTS: dict[str, tuple[Rover, Fault | None, float, str]] = {
    "laser_silent": (Rover(), laser_silent, 30.0, "laser_silent"),
    "odometry_silent": (Rover(), odometry_silent, 30.0, "odometry_silent"),
    "wheel_silent": (Rover(), wheel_silent, 30.0, "wheel_silent"),
    "wheel_stuck": (Rover(), wheel_stuck, 30.0, "wheel_stuck"),
    "laser_restarted": (Rover(), laser_restarted, 30.0, "scan_stamps_jump"),
    "checksum_errors": (Rover(), checksum_errors, 30.0, "laser_checksum"),
    "rate_low": (Rover(), rate_low, 30.0, "laser_rate_low"),
    "missed_beats": (Rover(), missed_beats, 30.0, "missed_beats"),
    "storage_gap": (Rover(), storage_gap, 30.0, "storage_gap"),
    "laser_late": (Rover(), laser_late, 30.0, "laser_late"),
    "clock_drift": (Rover(), clock_drift, 30.0, "laser_clock_drift"),
    "wheel_crc": (Rover(), wheel_crc, 30.0, "wheel_frames_damaged"),
    "wheel_restart": (Rover(), jump, 30.0, "wheel_node_restarted"),
    "blind": (Rover(), blind, 30.0, "laser_silent"),
    "left_wheel_smaller": (Rover(radius_left_m=0.125 * 0.97), None, 60.0, "wheel_radius_difference"),
    "left_wheel_0.7_percent": (Rover(radius_left_m=0.125 * 0.993), None, 300.0, "wheel_radius_difference"),
    "wheel_scale": (Rover(radius_left_m=0.125 * 1.03, radius_right_m=0.125 * 1.03), None, 60.0, "wheel_scale"),
    "tread": (Rover(tread_m=0.56), None, 60.0, "tread"),
    "laser_yaw_1.8_deg": (Rover(mount=(0.3, 0.0, np.radians(1.8))), None, 60.0, "laser_yaw"),
    "laser_yaw": (Rover(mount=(0.3, 0.0, 0.06)), None, 60.0, "laser_yaw"),
    "backwards": (Rover(), backwards, 30.0, "laser_yaw"),
    "upside_down": (Rover(), upside_down, 30.0, "laser_mirrored"),
    "laser_latency": (Rover(latency_s=0.09), None, 60.0, "laser_latency"),
}
"""Name: the rover as it really is, what happens to its data, seconds, and the kind of finding that must be named."""
