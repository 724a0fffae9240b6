"""A rover that has lost its place among walls finds it again by them, in its own map and in a saved one."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from drivers.measurements import OdometryPose
from slam.estimate import Estimate, Quality, Recognition
from slam.estimator import Estimator
from slam.joint.evidence import Evidence
from slam.keyframes.keyframes import Keyframes
from slam.maps.joint_map import JointMap
from slam.maps.start import MapStart
from slam.pose import Pose2
from slam.settings.slam import SlamSettings
from tests.support.slam.corridor import SCAN_NS, Stop, drive_round

MOUNT = Pose2(0.1, 0.0, 0.0)
SETTINGS = SlamSettings.model_validate(
    {"particles": 5, "mount": {"x_m": MOUNT.x_m}, "odometry": {"model": "pose", "gap_s": 4.0}}
)


@cache
def lap() -> tuple[Stop, ...]:
    return tuple(drive_round(1, 1.05, MOUNT))


@cache
def known() -> JointMap:
    estimator = Estimator(SETTINGS, 1)
    for stop in lap():
        estimator.step(stop.scan.stamp_ns, stop.scan, (stop.wheels,))
    return estimator.joint_map()


def later(stops: Sequence[Stop], by: int) -> list[Stop]:
    """The same stops with stamps that begin after so many scans."""
    return [
        replace(
            stop,
            scan=replace(stop.scan, stamp_ns=stop.scan.stamp_ns + by * SCAN_NS),
            wheels=replace(stop.wheels, stamp_ns=stop.wheels.stamp_ns + by * SCAN_NS),
        )
        for stop in stops
    ]


def mirrored(stops: Sequence[Stop]) -> list[Stop]:
    """A building that is the mirror image."""

    def turned(wheels: OdometryPose) -> OdometryPose:
        return OdometryPose(wheels.stamp_ns, wheels.x_m, -wheels.y_m, -wheels.heading_rad)

    return [
        replace(
            stop,
            scan=replace(
                stop.scan,
                ranges_m=np.ascontiguousarray(stop.scan.ranges_m[::-1]),
                bearings_rad=np.ascontiguousarray(-stop.scan.bearings_rad[::-1]),
            ),
            wheels=turned(stop.wheels),
        )
        for stop in stops
    ]


def driven(stops: Sequence[Stop], start: MapStart) -> tuple[list[Estimate], list[Recognition]]:
    estimator = Estimator(SETTINGS, 1, start=start)
    estimates = [estimator.step(stop.scan.stamp_ns, stop.scan, (stop.wheels,)) for stop in stops]
    return estimates, [found.recognition for found in estimates if found.recognition is not None]


def error_m(estimate: Estimate, stop: Stop) -> float:
    """Against the truth in the frame of the map, which begins where the first lap began."""
    true = lap()[0].map_from_body.inverse() @ stop.map_from_body
    off = true.inverse() @ estimate.map_from_body
    return float(np.hypot(off.x_m, off.y_m))


@pytest.mark.parametrize("localise_only", [True, False])
@pytest.mark.parametrize("first", [12, 45])
def test_a_second_drive_that_begins_anywhere_in_the_building_is_recognised(first: int, localise_only: bool) -> None:
    stops = drive_round(1, 1.0, MOUNT)[first:]
    digest = known().digest()
    estimates, recognitions = driven(stops, MapStart(known(), localise_only, None))
    assert [found.is_new for found in recognitions] == [False]
    when = next(number for number, estimate in enumerate(estimates) if estimate.recognition is not None)
    assert when < 40, "28 m"
    assert estimates[when - 1].quality is Quality.LOST
    assert "walls agree" in estimates[when - 1].doubt
    errors = [error_m(estimate, stop) for estimate, stop in zip(estimates[when:], stops[when:], strict=True)]
    assert np.median(errors) < 0.3
    assert known().digest() == digest


def test_the_mirror_image_of_the_building_is_not_taken_for_it() -> None:
    for first in (0, 30):
        estimates, recognitions = driven(mirrored(lap()[first:]), MapStart(known(), True, None))
        assert not [found for found in recognitions if not found.is_new]
        assert estimates[-1].counts["search_scan_odds"] < 14.0


def test_another_building_is_not_taken_for_it() -> None:
    _, recognitions = driven(drive_round(7, 1.0, MOUNT), MapStart(known(), True, None))
    assert not [found for found in recognitions if not found.is_new]


def test_a_rover_that_was_carried_through_its_own_map_finds_back() -> None:
    """After a lap it is put down elsewhere, and its wheels know nothing of it."""
    elsewhere = later(drive_round(1, 1.0, MOUNT)[20:], len(lap()))
    last, begun = lap()[-1].wheels, elsewhere[0].wheels
    moved = Pose2(last.x_m, last.y_m, last.heading_rad) @ Pose2(begun.x_m, begun.y_m, begun.heading_rad).inverse()
    estimator = Estimator(SETTINGS, 1)
    for stop in lap():
        estimator.step(stop.scan.stamp_ns, stop.scan, (stop.wheels,))
    found, errors = 0, []
    for stop in elsewhere:
        told = moved @ Pose2(stop.wheels.x_m, stop.wheels.y_m, stop.wheels.heading_rad)
        wheels = OdometryPose(stop.wheels.stamp_ns, told.x_m, told.y_m, told.heading_rad)
        estimate = estimator.step(stop.scan.stamp_ns, stop.scan, (wheels,))
        found += estimate.recognition is not None and not estimate.recognition.is_new
        errors.append(error_m(estimate, stop))
    assert errors[0] > 3.0
    assert found >= 1
    assert np.median(errors[-10:]) < 0.5


def test_a_pose_that_is_known_to_metres_only_is_found_again_in_its_own_map(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing speaks against it: no landmark is missed, and no single keyframe tells one door from the next."""
    monkeypatch.setattr("slam.joint.gaussian.score", lambda *_: Evidence())
    monkeypatch.setattr(Keyframes, "_close_far", lambda *_: False)
    estimator, stops = Estimator(SETTINGS, 1), drive_round(3, 1.7, MOUNT)
    recognitions, errors, closed = [], [], 0.0
    for number, stop in enumerate(stops):
        estimate = estimator.step(stop.scan.stamp_ns, stop.scan, (stop.wheels,))
        if number == 125:
            estimator._joint.predict(np.array((2.0, -1.0, 0.05)), np.diag((2.0, 2.0, 0.1)) ** 2)
        off = (stops[0].map_from_body.inverse() @ stop.map_from_body).inverse() @ estimate.map_from_body
        errors.append(math.hypot(off.x_m, off.y_m))
        if estimate.recognition is not None:
            recognitions.append(estimate.recognition)
        closed = estimate.counts["loops_closed"]
    assert [(found.by_scans, found.is_new, found.map_id) for found in recognitions] == [(True, False, 1)]
    assert errors[126] > 1.5
    assert max(errors[-10:]) < 0.5
    assert closed > 10, "from there on the old keyframes near by close the loop, as ever"


def test_the_same_drive_gives_the_same_bits() -> None:
    def hashes() -> list[bytes]:
        estimator, made = Estimator(SETTINGS, 1, start=MapStart(known(), True, None)), []
        for stop in lap()[12:30]:
            estimator.step(stop.scan.stamp_ns, stop.scan, (stop.wheels,))
            made.append(estimator.state_hash())
        return made

    assert hashes() == hashes()
