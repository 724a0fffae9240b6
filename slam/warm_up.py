"""Settings and two short drives that make every kernel of the estimator compile, with features given and with scans."""

from collections.abc import Iterator

import numpy as np

from drivers.measurements import (
    OdometryPose,
    Scan,
    ScanLike,
    Sightings,
    SpeedSteering,
    SpeedYawRate,
    WheelCounts,
    WheelSample,
    uniform_bearings,
)
from slam.arithmetic.functions import cosines_sines
from slam.front_end.alignment_kernels import EarlierScans, surface_normals
from slam.front_end.alignment_search import Search
from slam.front_end.wide_search import View, WideSearch
from slam.joint.association import apply_hypothesis, expected_within
from slam.joint.gaussian import JointGaussian
from slam.joint.measurement import FIRST_PLACE, JointArrays
from slam.observations import FeatureRows, Features, Sighting, usable_rows
from slam.pose import Pose2
from slam.recognise.warm_up import warm_up_recognition
from slam.scan_search.warm_up import warm_up_scan_search
from slam.settings.slam import SlamSettings

RINGS_M = np.array((4.0, 6.0, 9.0, 12.0))
BEARINGS_RAD = np.array((-1.0, 0.2, 0.9, -0.4))
TICK_NS = 100_000_000
TICKS = 15  # longer than any front end looks back
LATE_TICK = TICKS + 20
REST_TICKS = 2
BEAMS = 1081
POLES = ((4.0, -0.8), (6.0, 0.1), (9.0, 0.7))  # range m, bearing rad
POLE_HALF_WIDTH_M = 0.15
WALL_M = 12.0  # to the left and ahead: two walls that meet in a corner

LANDMARKS_IN_STATE = 8  # so few that some leave at the third stop of warm_up_window
AT_A_STOP = 12  # long enough for every landmark to be put away, or to be missed until it is removed

WarmUpTick = tuple[int, ScanLike, tuple[WheelSample, ...]]


def warm_up_settings(settings: SlamSettings, front_end: str) -> SlamSettings:
    """The same filter with few particles that resample in every scan, and this kind of front end."""
    tree = settings.model_dump()
    tree |= {"particles": 4, "resample_share": 1.0}
    tree["front_end"]["kind"] = front_end
    tree["joint"]["landmarks_in_state"] = LANDMARKS_IN_STATE
    return SlamSettings.model_validate(tree)


def warm_up_drive(settings: SlamSettings) -> Iterator[WarmUpTick]:
    """Stamps, sightings or scans of a few things, and wheel samples of a drive of a second and a half."""
    yield from _drive(settings, range(1, TICKS + 1))


def warm_up_gap(settings: SlamSettings) -> Iterator[WarmUpTick]:
    """The same drive seconds later: the scan is laid onto those before it."""
    yield from _drive(settings, range(LATE_TICK, LATE_TICK + 1))


def _drive(settings: SlamSettings, numbers: range) -> Iterator[WarmUpTick]:
    for tick in numbers:
        stamp_ns = tick * TICK_NS
        moved_m = 0.05 * max(tick - REST_TICKS, 0)
        seen = _sightings if settings.front_end.kind == "given" else _scan
        yield stamp_ns, seen(settings, stamp_ns, moved_m), (_wheel_sample(settings, stamp_ns, moved_m),)


def warm_up_window(joint: JointGaussian) -> None:
    """A keyframe, then things to the horizon and back: what leaves the joint state, comes back and is forgotten."""
    joint.add_keyframe()
    covariance = np.diag((1e-4, 1e-4, 1e-6))
    joint.predict(np.zeros(3), covariance)
    joint.condition(0, np.zeros(3), 0.5 * joint.from_keyframe(0)[1])
    stops = (0.0, 150.0, 150.0, -300.0)  # m ahead: the first things come into view again at the last stop but one
    hints = np.full(len(RINGS_M), -1)
    for ahead_m in stops:
        joint.step(np.array((ahead_m, 0.0, 0.0)), covariance, _features(len(RINGS_M)), hints)
        for _ in range(AT_A_STOP):
            joint.step(np.zeros(3), np.zeros((3, 3)), _features(len(RINGS_M)), hints)
    for _ in range(AT_A_STOP):
        joint.step(np.zeros(3), np.zeros((3, 3)), _features(0), hints[:0])
    mean = np.concatenate((np.zeros(FIRST_PLACE), (4.0, 0.0)))
    apply_hypothesis(mean, np.eye(len(mean)), np.zeros(3), 0, Sighting(4.0, 0.0, 1e-3, 0.0, 1e-4))


def _features(count: int) -> FeatureRows:
    """The first `count` of the things on rings."""
    covariances = np.tile(np.diag((1e-3, 1e-4)), (count, 1, 1))
    unknown = np.full(count, -1)
    may_create = np.ones(count, np.bool_)
    features = Features(0, RINGS_M[:count], BEARINGS_RAD[:count], covariances, may_create, unknown, unknown)
    return usable_rows(features, RINGS_M[-1], 0.0)


def _sightings(settings: SlamSettings, stamp_ns: int, moved_m: float) -> Sightings:
    identities = np.arange(4) if settings.association.strategy == "known" else np.full(4, -1)
    return Sightings(stamp_ns, RINGS_M - moved_m, BEARINGS_RAD.copy(), identities)


def _scan(_settings: SlamSettings, stamp_ns: int, moved_m: float) -> Scan:
    """Three poles before two walls."""
    bearings = uniform_bearings(-0.75 * np.pi, 1.5 * np.pi / (BEAMS - 1), BEAMS)
    cosines, sines = cosines_sines(bearings)
    with np.errstate(divide="ignore"):
        ahead = np.where(cosines > 0.0, (WALL_M - moved_m) / cosines, np.inf)
        left = np.where(sines > 0.0, WALL_M / sines, np.inf)
    ranges = np.minimum(ahead, left)
    for range_m, bearing_rad in POLES:
        near_m = range_m - moved_m
        ranges[np.abs(bearings - bearing_rad) < POLE_HALF_WIDTH_M / near_m] = near_m
    ranges[~np.isfinite(ranges)] = np.nan
    return Scan(stamp_ns, ranges.astype(np.float32), bearings, 1e-4, 0)


def _wheel_sample(settings: SlamSettings, stamp_ns: int, moved_m: float) -> WheelSample:
    """A sample of the kind that the configured motion model takes."""
    speed = 0.5 if moved_m > 0.0 else 0.0
    if settings.odometry.model == "steered":
        return SpeedSteering(stamp_ns, speed, 0.05)
    if settings.odometry.model == "speed_yaw_rate":
        return SpeedYawRate(stamp_ns, speed, 0.05 * speed)
    if settings.odometry.model == "pose":
        return OdometryPose(stamp_ns, moved_m, 0.0, 0.0)
    return WheelCounts(stamp_ns, 5000.0 * moved_m, 5200.0 * moved_m)


def warm_up_rare(joint: JointGaussian) -> None:
    """What no short drive comes to."""
    warm_up_wide_search()
    warm_up_window(joint)
    warm_up_recognition()
    warm_up_scan_search()


def warm_up_wide_search() -> None:
    """A scan that is looked for on itself."""
    bearings = uniform_bearings(-1.5, 0.03, 100)
    points = np.column_stack(cosines_sines(bearings)) * (5.0, 4.0)
    normals, start = np.empty_like(points), np.array(((0.0, 0.0, 1.0, 0.0),))
    surface_normals(points, 0.03, normals)
    search = Search(points, EarlierScans(points[None], normals[None], start, -1.5, 0.03))
    view = View(points, -1.5, 0.03)
    WideSearch(search, view, view, Pose2()).best(np.array((0.5, 0.0, 0.0)))
    expected_within(
        JointArrays(np.zeros(FIRST_PLACE), np.eye(FIRST_PLACE), FIRST_PLACE, np.zeros(3)), np.zeros(0, np.int64)
    )
