"""Ticks and estimates for the tests of the record: made from a generator, every kind of value in them."""

import numpy as np

from drivers.measurements import Event, Scan, Severity, Sightings, WheelCounts, uniform_bearings
from runtime.tick import Tick, Timing
from slam.estimate import Estimate, LandmarkMap, Quality
from slam.observations import Features
from slam.pose import Pose2

PERIOD_NS = 100_000_000
BEAMS = 1081


def make_tick(seq: int, rng: np.random.Generator, seen: str = "scan", beams: int = BEAMS) -> Tick:
    stamp_ns = seq * PERIOD_NS
    wheels = tuple(
        WheelCounts(stamp_ns - PERIOD_NS + k * 20_000_000, float(rng.normal()), float(rng.normal()), valid=k != 2)
        for k in range(5)
    )
    scan: Scan | Sightings | None = None
    if seen == "scan":
        bearings_rad = uniform_bearings(-0.75 * np.pi, 1.5 * np.pi / beams, beams)
        ranges_m = rng.integers(100, 60_000, beams).astype(np.float32) / np.float32(1000)
        ranges_m[rng.random(beams) < 0.1] = np.nan
        scan = Scan(stamp_ns - 30_000_000, ranges_m, bearings_rad, 0.025 / 360, beams // 2, 30.0)
    elif seen == "sightings":
        scan = Sightings(stamp_ns, rng.random(3) * 9.0, rng.normal(size=3), np.array([4, -1, 2]))
    events = (Event(stamp_ns, "laser", "checksum", "one reply had a wrong sum", Severity.WARN),) if seq % 7 == 0 else ()
    return Tick(seq, stamp_ns, scan, wheels, events)


def make_estimate(stamp_ns: int, rng: np.random.Generator, beams: int = BEAMS) -> Estimate:
    features = Features(
        stamp_ns,
        rng.random(4) * 20.0,
        rng.normal(size=4),
        np.tile(np.diag([0.01, 0.001]), (4, 1, 1)),
        np.array([True, False, True, True]),
        np.array([-1, -1, 7, -1]),
        np.array([3, 400, -1, 9]),
    )
    landmarks = LandmarkMap(
        np.array([4096, 8193]), rng.normal(size=(2, 2)), np.tile(np.eye(2) * 0.04, (2, 1, 1)), np.array([1.5, 3.0])
    )
    return Estimate(
        stamp_ns,
        Pose2(*rng.normal(size=3)),
        np.diag(rng.random(3)),
        Pose2(*rng.normal(size=3)),
        np.diag(rng.random(3)),
        Pose2(*rng.normal(size=3)),
        Quality.UNCERTAIN,
        rng.normal(size=(10, 3)),
        np.full(10, 0.1),
        features,
        np.array([4096, -1, -3, 8193]),
        rng.integers(0, 4, beams).astype(np.uint8),
        landmarks,
        {"landmarks": 2.0, "effective_particles": 55.25},
    )


def make_timing(seq: int) -> Timing:
    return Timing(1000 * seq, seq % 2, {"read": 20_000, "step": 3_000_000 + seq})


def same_bits(first: object, second: object) -> bool:
    """Equality of arrays by their bytes and of floats by their bits; NaN equals itself, 0.0 is not -0.0."""
    if isinstance(first, np.ndarray):
        assert isinstance(second, np.ndarray)
        return first.dtype == second.dtype and first.shape == second.shape and first.tobytes() == second.tobytes()
    if isinstance(first, float):
        return isinstance(second, float) and np.float64(first).tobytes() == np.float64(second).tobytes()
    if isinstance(first, tuple):
        assert isinstance(second, tuple)
        return len(first) == len(second) and all(same_bits(*pair) for pair in zip(first, second, strict=True))
    slots = getattr(type(first), "__slots__", None)
    if slots is None or isinstance(first, str):
        return type(first) is type(second) and first == second
    return type(first) is type(second) and all(same_bits(getattr(first, s), getattr(second, s)) for s in slots)
