"""The door into slam: stamps, determinism, bad input, and what an estimate holds."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.measurements import (
    FloatArray,
    OdometryPose,
    Scan,
    Sightings,
    SpeedSteering,
    SpeedYawRate,
    WheelCounts,
    WheelSample,
    uniform_bearings,
)
from slam.estimate import Estimate, Quality
from slam.estimator import Estimator
from slam.odometry.odometry import Increment, compound
from slam.pose import Pose2
from slam.settings.slam import SlamSettings
from slam.visibility import sight_line
from tests.support.examples import examples
from tests.support.slam.scenes import POSTS_M, arc_pose, increment_of, seen_from, settings_of

MS = 1_000_000
TICK = 100 * MS


def sightings(
    stamp_ns: int, pose: tuple[float, float, float] | FloatArray, noise: float = 0.0, seed: int = 0
) -> Sightings:
    seen = seen_from(np.asarray(pose), POSTS_M)
    generator = np.random.default_rng([seed, abs(stamp_ns)])
    return Sightings(
        stamp_ns,
        seen.ranges_m + noise * generator.normal(size=len(POSTS_M)),
        seen.bearings_rad + 0.2 * noise * generator.normal(size=len(POSTS_M)),
        np.full(len(POSTS_M), -1),
    )


def drive(estimator: Estimator, ticks: int, first: int = 0) -> list[Estimate]:
    """Half a second at rest, then an arc at 1 m/s; a scan in every second tick."""
    estimates, pose = [], np.zeros(3)
    for tick in range(first, first + ticks):
        moving = tick >= 5
        if tick > 5:
            pose = arc_pose(pose, 0.1, 0.02)
        wheel = SpeedYawRate(tick * TICK, 1.0, 0.2) if moving else SpeedYawRate(tick * TICK, 0.0, 0.0)
        scan = sightings(tick * TICK, pose, 0.02) if tick % 2 == 0 else None
        estimates.append(estimator.step(tick * TICK, scan, (wheel,)))
    return estimates


def test_the_published_pose_follows_the_course_between_scans_too() -> None:
    estimates = drive(Estimator(settings_of(), 1), 60)
    pose = np.zeros(3)
    for tick, estimate in enumerate(estimates):
        if tick > 5:
            pose = arc_pose(pose, 0.1, 0.02)
        assert math.hypot(estimate.map_from_body.x_m - pose[0], estimate.map_from_body.y_m - pose[1]) < 0.15
        assert estimate.stamp_ns == tick * TICK
        assert estimate.quality is Quality.TRACKING
        np.testing.assert_array_equal(estimate.covariance, estimate.covariance.T)
        assert np.linalg.eigvalsh(estimate.covariance).min() > -1e-12


def test_a_tick_without_scan_grows_the_covariance() -> None:
    estimates = drive(Estimator(settings_of(), 1), 60)
    assert np.trace(estimates[59].covariance) > np.trace(estimates[58].covariance)


def test_estimates_at_scans_hold_what_a_reviewer_wants_to_see() -> None:
    estimates = drive(Estimator(settings_of(), 1, map_every=5), 60)
    with_scan, without = estimates[20], estimates[21]
    assert with_scan.particles is not None
    assert with_scan.particles.shape == (20, 3)
    assert with_scan.particle_weights is not None
    assert with_scan.particle_weights.sum() == pytest.approx(1.0)
    assert with_scan.features is not None
    assert with_scan.matches is not None
    assert len(with_scan.matches) == len(with_scan.features) == len(POSTS_M)
    assert without.particles is None
    assert without.features is None
    maps = [estimate.landmarks for estimate in estimates if estimate.landmarks is not None]
    assert len(maps) == 30 // 5
    expected = {"landmarks", "matched", "created", "removed", "likelihoods", "effective_particles"}
    assert expected <= with_scan.counts.keys()


def test_particles_of_an_estimate_do_not_change_afterwards() -> None:
    estimator = Estimator(settings_of(), 1)
    early = drive(estimator, 21)[20]
    assert early.particles is not None
    before = early.particles.copy()
    drive(estimator, 20, first=21)
    np.testing.assert_array_equal(early.particles, before)


def test_two_runs_agree_in_every_hash_and_another_seed_in_none() -> None:
    def hashes(seed: int) -> list[bytes]:
        estimator, found = Estimator(settings_of(), seed), []
        for tick in range(30):
            drive(estimator, 1, first=tick)
            found.append(estimator.state_hash())
        return found

    first, second, other = hashes(1), hashes(1), hashes(2)
    assert first == second
    assert all(len(value) == 16 for value in first)
    assert first[-1] != other[-1]
    assert len(set(first[::2])) == 15


def test_one_changed_bit_of_input_shows_in_the_hash() -> None:
    first, second = Estimator(settings_of(), 1), Estimator(settings_of(), 1)
    for estimator, offset in ((first, 0.0), (second, 1e-12)):
        estimator.step(0, sightings(0, (0, 0, 0)), ())
        estimator.step(TICK, sightings(TICK, (offset, 0, 0)), (SpeedYawRate(0, 0.0, 0.0),))
    assert first.state_hash() != second.state_hash()


def test_a_scan_whose_time_stands_still_or_runs_back_is_ignored_and_counted() -> None:
    estimator = Estimator(settings_of(), 1)
    drive(estimator, 21)
    before = estimator.state_hash()
    for stamp_ns in (20 * TICK, 19 * TICK, -5):
        estimate = estimator.step(21 * TICK, sightings(stamp_ns, (9, 9, 0)), ())
        assert estimate.features is None
    assert estimate.counts["scan_stamps_refused"] == 3
    assert estimator.state_hash() == before


BAD_RANGES = {
    "no beams": np.empty(0),
    "one beam": np.array((3.0,)),
    "nothing back": np.full(541, np.nan),
    "all at one range": np.full(541, 5.0),
    "all zero": np.zeros(541),
    "infinite": np.full(541, np.inf),
    "fewer beams than before": np.full(100, 4.0),
    "more beams than before": np.linspace(1.0, 50.0, 2000),
}


def test_scans_of_every_bad_kind_leave_the_estimate_finite() -> None:
    estimator = Estimator(settings_of(front_end={"kind": "robust"}), 1)
    for tick, ranges in enumerate(BAD_RANGES.values()):
        bearings = uniform_bearings(-2.3, 4.6 / max(len(ranges), 1), len(ranges))
        scan = Scan(tick * TICK, ranges.astype(np.float32), bearings)
        estimate = estimator.step(tick * TICK, scan, (SpeedYawRate(tick * TICK, 0.5, 0.1),))
        assert_finite(estimate)


def assert_finite(estimate: Estimate) -> None:
    for pose in (estimate.map_from_body, estimate.particle_mean, estimate.odom_from_body):
        assert np.isfinite(pose.as_array()).all()
    assert np.isfinite(estimate.covariance).all()
    assert np.isfinite(estimate.particle_covariance).all()


NUMBERS = st.one_of(st.floats(-5, 5), st.sampled_from((math.nan, math.inf, -math.inf, 1e300)))
STAMPS = st.integers(-3, 40)
WHEELS = st.tuples(STAMPS, NUMBERS, NUMBERS)
TICKS = st.lists(
    st.tuples(STAMPS, st.lists(WHEELS, max_size=3), st.none() | st.lists(st.tuples(NUMBERS, NUMBERS), max_size=5)),
    max_size=25,
)


@examples(60)
@given(TICKS)
def test_no_input_makes_an_estimate_that_is_not_a_number(ticks: list[tuple[int, list[Any], list[Any] | None]]) -> None:
    estimator = Estimator(settings_of(particles=5), 1)
    for number, (stamp, wheels, seen) in enumerate(ticks):
        scan = None
        if seen is not None:
            values = np.array(seen, dtype=np.float64).reshape(-1, 2)
            scan = Sightings(stamp * TICK, values[:, 0].copy(), values[:, 1].copy(), np.full(len(values), -1))
        samples: tuple[WheelSample, ...] = tuple(SpeedYawRate(t * TICK, v, w) for t, v, w in wheels)
        assert_finite(estimator.step(number * TICK, scan, samples))


def test_an_estimator_that_sees_nothing_says_so_and_that_it_is_lost_in_the_end() -> None:
    estimator = Estimator(settings_of(), 1)
    assert estimator.step(0, None, ()).quality is Quality.UNCERTAIN
    drive(estimator, 21)
    assert estimator.step(200 * TICK, None, ()).quality is Quality.LOST


@pytest.mark.parametrize("proposal", ["motion", "ekf", "unscented"])
def test_warming_up_leaves_no_kernel_to_compile_in_the_first_tick(proposal: str) -> None:
    import slam.particles.step

    chosen = settings_of(proposal=proposal)
    Estimator.warm_up(chosen)
    compiled = len(slam.particles.step.step_particles.signatures)  # type: ignore[attr-defined]
    drive(Estimator(chosen, 1), 12)
    assert len(slam.particles.step.step_particles.signatures) == compiled == 1  # type: ignore[attr-defined]


@pytest.mark.parametrize("model", ["differential", "steered", "speed_yaw_rate", "pose"])
def test_warming_up_works_for_every_kind_of_wheels(model: str) -> None:
    Estimator.warm_up(SlamSettings.model_validate({"odometry": {"model": model}}))


def test_compounding_agrees_with_samples() -> None:
    generator = np.random.default_rng(0)
    pose, covariance = Pose2(1.0, 2.0, 0.7), np.diag((0.01, 0.02, 0.001))
    step: Increment = increment_of(3.0, 0.5, 0.2, sigma=0.05)
    moved = []
    for _ in range(4000):
        start = Pose2(*(pose.as_array() + np.sqrt(np.diag(covariance)) * generator.normal(size=3)))
        by = step.mean + np.sqrt(np.diag(step.covariance)) * generator.normal(size=3)
        moved.append((start @ Pose2(*by)).as_array())
    np.testing.assert_allclose(compound(pose, covariance, step), np.cov(np.array(moved).T), atol=2e-3)


def test_a_scan_as_sight_line_keeps_its_ranges_and_where_beams_point() -> None:
    ranges = np.array((1.0, np.nan, 3.0), dtype=np.float32)
    line = sight_line(Scan(0, ranges, uniform_bearings(-0.5, 0.5, 3), range_max_m=25.0))
    assert line[:3] == (-0.5, 0.5, 25.0)
    np.testing.assert_array_equal(line.ranges_m, ranges)


def test_the_first_scan_begins_the_map_whatever_came_before_it() -> None:
    """Wheels that were not valid before the first scan leave no doubt on a pose that defines the map."""
    estimator = Estimator(SlamSettings(particles=3), 1)
    second = 10**9
    for step in range(20):
        estimator.step(step * second // 10, None, (WheelCounts(step * second // 10, 0.0, 0.0, valid=step != 5),))
    scan = Scan(2 * second, np.full(361, 5.0, np.float32), uniform_bearings(-1.57, 3.14 / 360, 361), 0.0)
    estimate = estimator.step(2 * second, scan, (WheelCounts(2 * second, 0.0, 0.0),))
    assert np.sqrt(np.diag(estimate.covariance)).max() < 1e-5


def test_a_step_that_fails_loses_its_scan_but_not_the_motion_of_the_wheels() -> None:
    """Beams that turn the wrong way make the front end raise; the rover has moved all the same."""
    estimator = Estimator(SlamSettings(particles=3), 1)
    bearings = uniform_bearings(-1.57, 3.14 / 360, 361)
    counts_per_m = 4096.0 / (2.0 * np.pi * 0.125)
    ranges = np.where(np.abs(np.abs(bearings) - 0.5) < 0.02, 5.0, 12.0).astype(np.float32)
    failed, before_m = 0, 0.0
    for step in range(40):
        stamp_ns, moved_m = step * 10**8, 0.05 * max(step - 20, 0)
        scan = Scan(stamp_ns, ranges, bearings, 0.0)
        if step >= 30:
            scan = Scan(stamp_ns, ranges, bearings[::-1].copy(), 0.0)
        wheels = (WheelCounts(stamp_ns, counts_per_m * moved_m, counts_per_m * moved_m),)
        try:
            estimate = estimator.step(stamp_ns, scan, wheels)
        except ValueError:
            failed += 1
            estimate = estimator.step(stamp_ns, None, ())
        if step == 29:
            before_m = estimate.map_from_body.x_m
    assert failed == 10
    assert estimate.map_from_body.x_m - before_m == pytest.approx(0.5, abs=0.02)
    assert estimate.covariance[0, 0] > 0.0


FAR_NS = 3600 * 10**9
FUTURE = {
    "speed": SpeedYawRate(FAR_NS, 1.0, 0.2),
    "counts": WheelCounts(FAR_NS, 5.0, 5.0),
    "invalid counts": WheelCounts(FAR_NS, 0.0, 0.0, valid=False),
    "steering": SpeedSteering(FAR_NS, 1.0, 0.0),
    "pose": OdometryPose(FAR_NS, 0.0, 0.0, 0.0),
}


def test_a_scan_from_the_future_is_refused_and_those_after_it_are_used() -> None:
    estimator, untouched = Estimator(settings_of(), 1), Estimator(settings_of(), 1)
    drive(estimator, 21)
    drive(untouched, 21)
    estimator.step(20 * TICK, sightings(FAR_NS, (9, 9, 0)), ())
    assert drive(estimator, 40, first=21)[-1].counts["scan_stamps_ahead_refused"] == 1
    drive(untouched, 40, first=21)
    assert estimator.state_hash() == untouched.state_hash()


@pytest.mark.parametrize("sample", FUTURE.values(), ids=FUTURE)
def test_a_wheel_sample_from_the_future_is_refused_and_those_after_it_are_used(sample: WheelSample) -> None:
    estimator, untouched = Estimator(settings_of(), 1), Estimator(settings_of(), 1)
    drive(estimator, 21)
    drive(untouched, 21)
    estimator.step(20 * TICK, None, (sample,))
    assert drive(estimator, 40, first=21)[-1].counts["wheel_stamps_ahead_refused"] == 1
    drive(untouched, 40, first=21)
    assert estimator.state_hash() == untouched.state_hash()


def test_a_clock_that_is_set_back_stops_neither_scans_nor_wheels() -> None:
    estimator = Estimator(settings_of(), 1)
    for tick in range(10):
        seen = sightings(FAR_NS + tick * TICK, (0, 0, 0), 0.02)
        estimator.step(FAR_NS + tick * TICK, seen, (SpeedYawRate(FAR_NS + tick * TICK, 0.0, 0.0),))
    last = drive(estimator, 61)[-1]
    assert last.counts["scan_stamps_refused"] == 0
    assert "wheel_stamps_refused" not in last.counts
    assert last.quality is Quality.TRACKING
    pose = np.zeros(3)
    for _ in range(6, 61):
        pose = arc_pose(pose, 0.1, 0.02)
    assert math.hypot(last.map_from_body.x_m - pose[0], last.map_from_body.y_m - pose[1]) < 0.2


def test_a_laser_upside_down_leads_to_the_same_poses() -> None:
    """Left and right are exchanged in what it sees; the mount says so."""
    mount = {"x_m": 0.3, "yaw_rad": 0.1}
    upright, hanging = (
        Estimator(SlamSettings.model_validate({"particles": 5, "mount": {**mount, "upside_down": down}}), 1)
        for down in (False, True)
    )
    bearings = uniform_bearings(-1.57, 3.14 / 360, 361)
    ranges = np.where(np.abs(bearings - 0.5) < 0.03, 5.0, 12.0).astype(np.float32)
    for step in range(30):
        stamp_ns = step * 10**8
        wheels = (WheelCounts(stamp_ns, 300.0 * max(0, step - 15), 320.0 * max(0, step - 15)),)
        scan = Scan(stamp_ns, ranges, bearings, 0.0001, 0)
        first = upright.step(stamp_ns, scan, wheels)
        second = hanging.step(stamp_ns, scan.mirrored(), wheels)
        assert second.map_from_body == first.map_from_body
    assert first.counts["features"] > 0
    assert upright.state_hash() == hanging.state_hash()
