"""A made-up drive for the review: a rover circles among poles in a walled yard, one person walks through."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import Event, Scan, Severity, WheelCounts, uniform_bearings
from runtime.messages.records import tick_records
from runtime.messages.tick import Record
from runtime.tick import CompletedTick, Tick, Timing
from slam.estimate import Estimate, LandmarkMap, Quality
from slam.observations import BeamVerdict, Features, MatchVerdict
from slam.pose import Pose2
from slam.settings.slam import MountSettings

PERIOD_NS = 100_000_000
BEARINGS_RAD = uniform_bearings(-0.75 * np.pi, np.pi / 720.0, 1081)
MOUNT = MountSettings(x_m=0.3)
RANGE_M = 30.0
YARD_M = 22.0
POLE_M = 0.15


def poles(rng: np.random.Generator, count: int = 40) -> NDArray[np.float64]:
    return rng.uniform(-YARD_M + 2, YARD_M - 2, (count, 2))


def truth_at(stamp_ns: int, start_ns: int) -> Pose2:
    """10 m circles at 1 m/s, beginning at the map's origin after two seconds at rest."""
    angle_rad = max(0.0, (stamp_ns - start_ns) * 1e-9 - 2.0) / 10.0
    return Pose2(10.0 * math.sin(angle_rad), 10.0 - 10.0 * math.cos(angle_rad) - 5.0, angle_rad)


def cast(
    laser: Pose2, bearings_rad: NDArray[np.float64], discs: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Range of each beam and which disc it hit: -1 a wall, -2 nothing."""
    directions = np.stack((np.cos(bearings_rad + laser.heading_rad), np.sin(bearings_rad + laser.heading_rad)), -1)
    origin = np.array((laser.x_m, laser.y_m))
    with np.errstate(divide="ignore"):
        walls_m = np.where(directions > 0, (YARD_M - origin) / directions, (-YARD_M - origin) / directions).min(axis=1)
    offset = discs - origin
    along_m = directions @ offset.T
    across2_m2 = (offset**2).sum(axis=1)[None] - along_m**2
    depth_m2 = POLE_M**2 - across2_m2
    hits_m = np.where((depth_m2 > 0) & (along_m > 0), along_m - np.sqrt(depth_m2.clip(min=0)), np.inf)
    nearest = hits_m.argmin(axis=1)
    ranges_m = np.minimum(walls_m, hits_m.min(axis=1))
    hit = np.where(hits_m.min(axis=1) < walls_m, nearest, -1)
    hit[ranges_m > RANGE_M] = -2
    return np.where(ranges_m > RANGE_M, np.nan, ranges_m), hit


def drive(ticks: int, seed: int = 1, start_ns: int = 5_000_000_000) -> Iterator[list[Record]]:
    """Records of each tick."""
    return (tick_records(completed) for completed in completed_ticks(ticks, seed, start_ns))


def completed_ticks(ticks: int, seed: int = 1, start_ns: int = 5_000_000_000) -> Iterator[CompletedTick]:
    """Each tick with what came of it."""
    rng = np.random.default_rng(seed)
    yard = poles(rng)
    seen = np.zeros(len(yard))
    drift = Pose2()
    for seq in range(ticks):
        stamp_ns = start_ns + seq * PERIOD_NS
        truth, scan_ns = truth_at(stamp_ns, start_ns), stamp_ns - 40_000_000
        person = np.array(((-15.0 + 0.12 * seq) % 40 - 20, 3.0))
        ranges_m, hit = cast(truth_at(scan_ns, start_ns) @ MOUNT.as_pose(), BEARINGS_RAD, np.vstack((yard, person)))
        ranges_m += rng.normal(0, 0.01, ranges_m.shape)
        scan = Scan(scan_ns, ranges_m.astype(np.float32), BEARINGS_RAD, 0.0, 540, RANGE_M)
        verdicts = np.full(1081, BeamVerdict.KEPT, np.uint8)
        verdicts[hit == -2] = BeamVerdict.NO_RETURN
        verdicts[hit == len(yard)] = BeamVerdict.MOVED
        verdicts[(hit == -1) & (rng.random(1081) < 0.1)] = BeamVerdict.NOT_COMPARED
        visible = [name for name in range(len(yard)) if (hit == name).sum() >= 2]
        beams = np.array([int(np.flatnonzero(hit == name).mean()) for name in visible], np.int64)
        matches = np.array([name if seen[name] else MatchVerdict.NEW for name in visible], np.int64)
        if len(matches) > 3 and seq % 3 == 0:
            matches[seq % len(matches)] = -2 - seq % 4
        seen[visible] += 1
        features = Features(
            scan_ns,
            ranges_m[beams] + POLE_M,
            BEARINGS_RAD[beams],
            np.tile(np.diag((4e-4, 1e-5)), (len(beams), 1, 1)),
            np.ones(len(beams), np.bool_),
            np.full(len(beams), -1),
            beams,
        )
        drift = drift @ Pose2(0.002, 0.0003, 0.0004) if seq > 20 else drift
        pose = truth @ Pose2(*rng.normal(0, (0.02, 0.02, 0.002)))
        known = np.flatnonzero(seen)
        landmarks = LandmarkMap(
            known,
            yard[known] + 0.02,
            np.array([np.diag((0.05, 0.02)) / seen[name] + 1e-4 for name in known]).reshape(-1, 2, 2),
            np.minimum(4.0, 0.2 * seen[known] - 1.0),
        )
        particles = np.array(pose.as_array()) + rng.normal(0, (0.04, 0.04, 0.004), (100, 3))
        estimate = Estimate(
            stamp_ns,
            pose,
            np.diag((0.03**2, 0.05**2, 0.003**2)),
            pose,
            np.diag((0.03**2, 0.05**2, 0.003**2)),
            truth @ drift,
            Quality.TRACKING,
            particles,
            np.full(100, 0.01),
            features,
            matches,
            verdicts,
            landmarks if seq % 10 == 0 else None,
            {
                "landmarks": float(len(known)),
                "matched": float((matches >= 0).sum()),
                "features": float(len(matches)),
                "effective_particles": 60.0 + 30.0 * math.sin(seq / 9.0),
            },
        )
        warning = Event(stamp_ns, "laser", "checksum", "one line had a wrong sum", Severity.WARN)
        events = (warning,) if seq % 97 == 5 else ()
        wheels = tuple(WheelCounts(stamp_ns - 90_000_000 + k * 20_000_000, 10.0 * seq, 10.0 * seq) for k in range(5))
        timing = Timing(int(rng.exponential(80_000)), 0, {"read": 30_000, "step": int(rng.normal(11e6, 1e6))})
        tick = Tick(seq, stamp_ns, scan, wheels, events)
        yield CompletedTick(tick, estimate, timing, bytes(16), truth)
