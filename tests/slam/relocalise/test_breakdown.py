"""A number of the filter that is none any more ends no drive: the pose is lost with its cause, and found anew."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from drivers.measurements import Sightings, SpeedYawRate
from runtime.fault_isolation import step_or_predict
from runtime.tick import Tick
from slam.estimate import Estimate, Quality
from slam.estimator import Estimator
from slam.maps.start import MapStart
from slam.pose import Pose2
from slam.relocalise.breakdown import BrokenFilterError
from tests.support.slam.scenes import POSTS_M, arc_pose, seen_from, settings_of

TICK_NS = 100_000_000
SETTINGS = settings_of()
Spoil = Callable[[Estimator, float], None]


def ticks(count: int) -> Iterator[Tick]:
    """An arc among posts, with a scan in every tick."""
    pose = np.zeros(3)
    for number in range(count):
        seen = seen_from(pose, POSTS_M)
        stamp_ns = number * TICK_NS
        names = np.full(len(seen.ranges_m), -1)
        sighted = Sightings(stamp_ns, seen.ranges_m.copy(), seen.bearings_rad.copy(), names)
        yield Tick(number, stamp_ns, sighted, (SpeedYawRate(stamp_ns, 1.0, 0.2),))
        pose = arc_pose(pose, 0.1, 0.02)


def joint_mean(entry: int) -> Spoil:
    def spoil(estimator: Estimator, value: float) -> None:
        estimator._joint.state.mean[entry] = value

    return spoil


def joint_covariance(row: int, column: int) -> Spoil:
    def spoil(estimator: Estimator, value: float) -> None:
        estimator._joint.state.covariance[row, column] = value

    return spoil


def particle(column: int) -> Spoil:
    def spoil(estimator: Estimator, value: float) -> None:
        estimator._particles.poses[:, column] = value

    return spoil


def score(estimator: Estimator, value: float) -> None:
    estimator._quality._score = value if math.isnan(value) else math.nan


MAP = [joint_mean(0), joint_mean(2), joint_mean(4), joint_mean(8), joint_covariance(2, 2), joint_covariance(0, 2)]
OTHERS = [particle(0), particle(2), score]
VALUES = [math.nan, math.inf, -1e300]


def is_finite(estimate: Estimate) -> bool:
    poses = (estimate.map_from_body, estimate.particle_mean, estimate.odom_from_body)
    covariances = (estimate.covariance, estimate.particle_covariance)
    return all(np.isfinite(part).all() for part in (*(pose.as_array() for pose in poses), *covariances))


def driven(spoil: Spoil, value: float, count: int, at: int = 10) -> tuple[list[Estimate], list[str]]:
    """Estimates and defects of a drive in which a number is spoilt before tick `at`."""
    estimator, estimates, defects = Estimator(SETTINGS, 1), [], []
    for tick in ticks(count):
        if tick.seq == at:
            spoil(estimator, value)
        estimate, events = step_or_predict(estimator, tick)
        estimates.append(estimate)
        defects += [event.reason for event in events]
    return estimates, defects


@pytest.mark.parametrize("value", VALUES)
@pytest.mark.parametrize("spoil", MAP)
def test_a_broken_map_is_told_as_lost_with_its_cause_and_the_drive_goes_on_in_a_new_one(
    spoil: Spoil, value: float
) -> None:
    estimates, defects = driven(spoil, value, 60)
    assert len(defects) == 1
    assert defects[0].startswith("BrokenFilterError: the pose or a landmark of the joint Gaussian is not finite")
    assert all(is_finite(estimate) for estimate in estimates)
    broken = estimates[10]
    assert broken.quality is Quality.LOST
    assert broken.doubt.startswith("the filter broke down: the pose or a landmark of the joint Gaussian is not finite")
    assert [estimate.recognition is not None for estimate in estimates[9:13]] == [False, True, False, False]
    assert broken.recognition is not None
    assert broken.recognition.is_new
    gap = estimates[9].map_from_body.inverse() @ broken.map_from_body
    assert math.hypot(gap.x_m, gap.y_m) < 0.3
    assert estimates[-1].quality is Quality.TRACKING
    assert estimates[-1].counts["not_finite"] == 1.0
    assert estimates[-1].counts["matched"] == len(POSTS_M)


@pytest.mark.parametrize("value", VALUES)
@pytest.mark.parametrize("spoil", OTHERS)
def test_broken_particles_are_drawn_anew_around_the_pose_that_is_published(spoil: Spoil, value: float) -> None:
    estimates, defects = driven(spoil, value, 20)
    assert len(defects) == 1
    assert defects[0].startswith("BrokenFilterError: the ")
    assert all(is_finite(estimate) for estimate in estimates)
    assert estimates[-1].quality is Quality.TRACKING
    assert all(estimate.recognition is None for estimate in estimates)


def test_a_prediction_without_a_scan_finds_it_out_as_well() -> None:
    estimator = Estimator(SETTINGS, 1)
    *before, last = ticks(12)
    for tick in before:
        estimator.step(tick.stamp_ns, tick.scan, tick.wheels)
    joint_covariance(0, 0)(estimator, math.nan)
    estimate = estimator.step(last.stamp_ns, None, last.wheels)
    assert is_finite(estimate)
    assert estimate.quality is Quality.LOST
    assert "is not finite" in estimate.doubt


@pytest.mark.parametrize("localise_only", [True, False])
def test_a_saved_map_is_not_lost_with_the_pose_in_it(localise_only: bool) -> None:
    first = Estimator(SETTINGS, 1)
    for tick in ticks(60):
        first.step(tick.stamp_ns, tick.scan, tick.wheels)
    known = first.joint_map()
    estimator = Estimator(SETTINGS, 1, start=MapStart(known, localise_only, Pose2()))
    for tick in ticks(3):
        estimator.step(tick.stamp_ns, tick.scan, tick.wheels)
    joint_mean(8)(estimator, math.nan)
    estimate = estimator.step(3 * TICK_NS, None, ())
    assert estimate.quality is Quality.LOST
    kept = estimator.joint_map()
    assert len(kept) >= len(known)
    assert all(np.isfinite(array).all() for array in (kept.means_m, kept.covariances_m2, kept.block_m2))


def test_what_fails_without_a_scan_too_is_said_and_not_raised() -> None:
    class Defective(Estimator):
        def step(self, *_: object, **__: object) -> Estimate:
            raise BrokenFilterError("nothing goes any more")

    tick = replace(next(ticks(1)), seq=7)
    estimate, events = step_or_predict(Defective(SETTINGS, 1), tick)
    assert estimate.quality is Quality.LOST
    assert estimate.stamp_ns == tick.stamp_ns
    assert "nothing goes any more" in estimate.doubt
    assert len(events) == 2
    assert is_finite(estimate)
