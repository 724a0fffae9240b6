from dataclasses import replace

import numpy as np
import pytest

from drivers.measurements import FloatArray, ScanLike
from slam.estimate import Quality
from slam.estimator import Estimator
from slam.front_end.alignment import Alignment
from slam.front_end.deskew import Beams, Twist, deskew
from slam.front_end.wide_search import Known, unknown
from slam.joint.evidence import Evidence
from slam.joint.gaussian import JointGaussian
from slam.keyframes.keyframes import Keyframes
from slam.odometry.odometry import Increment
from slam.pose import Pose2
from slam.settings.joint import JointSettings
from slam.settings.slam import SlamSettings
from tests.support.slam.corridor import Stop, drive_round

MOUNT = Pose2(0.1, 0.0, 0.0)
GONE = Evidence(known=5, missed=5, against=2.0)
WHEELS = np.diag((0.05, 0.05, 0.03)) ** 2


@pytest.fixture(scope="module")
def stops() -> list[Stop]:
    return drive_round(1, 0.2, MOUNT)


def beams_of(stop: Stop) -> Beams:
    return deskew(stop.scan, Twist(), MOUNT, 0.1, 20.0)


def driven(stops: list[Stop], errors: FloatArray) -> tuple[JointGaussian, Keyframes]:
    """The true motion with an error (n, 3) a step, each scan laid onto keyframes."""
    joint = JointGaussian(JointSettings(), MOUNT, SlamSettings().tuning())
    keyframes = Keyframes(joint, MOUNT)
    before = stops[0].map_from_body
    for stop, error in zip(stops, errors, strict=True):
        moved = (before.inverse() @ stop.map_from_body).as_array() + error
        joint.predict(moved, WHEELS)
        keyframes.constrain(beams_of(stop))
        keyframes.keep(beams_of(stop))
        before = stop.map_from_body
    return joint, keyframes


def error_of(joint: JointGaussian, stops: list[Stop]) -> FloatArray:
    true = stops[0].map_from_body.inverse() @ stops[-1].map_from_body
    return (true.inverse() @ joint.map_from_body).as_array()


def test_scans_laid_onto_keyframes_take_out_most_of_what_the_wheels_err_by(stops: list[Stop]) -> None:
    rng = np.random.default_rng(3)
    errors = rng.normal(size=(len(stops), 3)) * np.sqrt(np.diag(WHEELS))
    errors[0] = 0.0
    joint, keyframes = driven(stops, errors)
    assert keyframes.figures["keyframe_fits"] >= len(stops) // 2
    assert 1 < len(keyframes) <= len(stops)
    by_wheels = np.abs(errors[:, 2].sum())
    assert np.abs(error_of(joint, stops)[2]) < 0.2 * max(by_wheels, 0.05)
    assert np.hypot(*error_of(joint, stops)[:2]) < 0.2


def test_a_rover_that_comes_back_closes_its_loop_with_an_old_keyframe(stops: list[Stop]) -> None:
    there_and_back = stops + stops[-2::-1]
    rng = np.random.default_rng(4)
    errors = rng.normal(size=(len(there_and_back), 3)) * 0.3 * np.sqrt(np.diag(WHEELS))
    errors[0] = 0.0
    joint, keyframes = driven(there_and_back, errors)
    assert keyframes.figures["loops_closed"] > 0
    assert np.hypot(*error_of(joint, there_and_back)[:2]) < 0.1
    assert np.sqrt(np.trace(joint.covariance[:2, :2])) < 0.15


@pytest.mark.parametrize(("off_m", "has_another"), [(0.4, True), (0.4, False), (0.0, True)])
def test_a_filter_that_is_wrong_and_sure_of_itself_is_corrected_by_two_old_keyframes_and_not_by_one(
    stops: list[Stop], off_m: float, has_another: bool
) -> None:
    """The rover drives a while and comes back to the start; something moves its pose by more than its sigma admits."""
    there_and_back = [*stops, *stops[-2::-1]]
    joint, keyframes = driven(there_and_back, np.zeros((len(there_and_back), 3)))
    sigma_m = np.sqrt(np.trace(joint.from_keyframe(0)[1][:2, :2]))
    joint.state.mean[1] += off_m
    assert sigma_m < 0.1
    if not has_another:
        number = min(len(keyframes), 2)
        joint.keyframe_ends, keyframes._keyframes[number:] = joint.keyframe_ends[:number], []
    before = stops[0]
    for stop in stops[1:4]:
        moved = before.map_from_body.inverse() @ stop.map_from_body
        joint.predict(moved.as_array(), np.diag((0.002, 0.002, 0.002)) ** 2)
        keyframes.constrain(beams_of(stop))
        before = stop
    off = stops[0].map_from_body.inverse() @ stops[3].map_from_body
    error = (off.inverse() @ joint.map_from_body).as_array()
    assert bool(np.hypot(*error[:2]) < 0.1) is (has_another or off_m == 0.0)
    assert (keyframes.figures["poses_overruled"] > 0) is (off_m > 0.0 and has_another)


@pytest.mark.parametrize("has_another", [True, False])
def test_a_loop_is_closed_from_afar_by_two_old_keyframes_and_not_by_one(stops: list[Stop], has_another: bool) -> None:
    """A corridor looks alike a metre on: after a lap, known to 0.67 m, one old keyframe moved a rover by 0.76 m."""
    there_and_back = [*stops, *stops[-2::-1]]
    joint, keyframes = driven(there_and_back, np.zeros((len(there_and_back), 3)))
    joint.state.mean[1] += 0.45
    joint.predict(np.zeros(3), np.diag((0.4, 0.4, 0.02)) ** 2)
    if not has_another:
        seen = keyframes._keyframes
        seen[1:] = [replace(other, normals=np.full_like(other.normals, np.nan)) for other in seen[1:]]
    moved_m, before = [], stops[0]
    for stop in stops[1:5]:
        expected = joint.map_from_body @ (before.map_from_body.inverse() @ stop.map_from_body)
        joint.predict((joint.map_from_body.inverse() @ expected).as_array(), np.diag((0.002, 0.002, 0.002)) ** 2)
        keyframes.constrain(beams_of(stop))
        moved_m.append(np.hypot(*(expected.inverse() @ joint.map_from_body).as_array()[:2]))
        before = stop
    off = stops[0].map_from_body.inverse() @ stops[4].map_from_body
    error = (off.inverse() @ joint.map_from_body).as_array()
    assert bool(np.hypot(*error[:2]) < 0.1) is has_another
    assert bool(max(moved_m) > 0.3) is has_another
    assert keyframes.figures["poses_overruled"] == 0


def test_the_filter_is_told_what_a_fit_claims(stops: list[Stop]) -> None:
    _, keyframes = driven(stops[:3], np.zeros((3, 3)))
    keyframes.take_fits()
    laid = keyframes._fits.fit(0, keyframes.thinned(beams_of(stops[2])))
    assert laid is not None
    assert keyframes.take_fits()[0].information == pytest.approx(laid.information - laid.held)


def test_a_scan_of_another_place_is_not_believed(stops: list[Stop]) -> None:
    joint, keyframes = driven(stops[:1], np.zeros((1, 3)))
    joint.predict(np.array((0.5, 0.0, 0.0)), WHEELS)
    before = joint.map_from_body
    elsewhere = stops[0].scan.ranges_m[::-1] * 0.4
    other = beams_of(
        Stop(
            stops[0].map_from_body,
            type(stops[0].scan)(
                stops[0].scan.stamp_ns, np.ascontiguousarray(elsewhere), stops[0].scan.bearings_rad, 0.0, 0
            ),
            stops[0].wheels,
        )
    )
    assert not keyframes.constrain(other)
    assert joint.map_from_body == before


@pytest.mark.parametrize("is_asked", [True, False])
def test_corners_that_are_missed_lose_a_rover_only_where_its_scans_do_not_lie_on_the_map(
    is_asked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second time round the ring, none of the corners is found where it should be; the pose is right all the time."""
    tree = {"particles": 10, "mount": {"x_m": MOUNT.x_m}, "odometry": {"model": "pose", "gap_s": 4.0}}
    estimator, lost = Estimator(SlamSettings.model_validate(tree), 1), 0
    if not is_asked:
        monkeypatch.setattr(Keyframes, "lies_on", lambda *_: False)
    stops = drive_round(1, 1.8, MOUNT)
    for number, stop in enumerate(stops):
        if number == int(len(stops) / 1.5):
            monkeypatch.setattr("slam.joint.gaussian.score", lambda *_: GONE)
        lost += estimator.step(stop.scan.stamp_ns, stop.scan, (stop.wheels,)).quality is Quality.LOST
    assert (lost == 0) is is_asked


def test_a_scan_lies_on_the_map_where_the_pose_is_right_and_not_where_it_is_wrong(stops: list[Stop]) -> None:
    """The rover drives a while and comes back over its own way; then it is carried to other places of the ring."""
    joint, keyframes = driven(stops, np.zeros((len(stops), 3)))
    last, settled = beams_of(stops[-1]), joint.scans + 1
    assert keyframes.lies_on(last, settled)
    assert not keyframes.lies_on(last, joint.scans)  # a keyframe that is younger than the doubt says nothing
    elsewhere = drive_round(2, 1.0, MOUNT)[10:]
    lying = sum(keyframes.lies_on(beams_of(stop), settled) for stop in elsewhere)
    assert lying <= 0.05 * len(elsewhere)  # these corridors are all of one width; in real places it is one in a hundred


def test_the_map_knows_a_scan_where_the_wheels_are_nearly_right_and_nowhere_else(stops: list[Stop]) -> None:
    _, keyframes = driven(stops[:-2], np.zeros((len(stops) - 2, 3)))
    true = (stops[-3].map_from_body.inverse() @ stops[-1].map_from_body).as_array()
    wheels = np.diag((0.3, 0.3, 0.15)) ** 2
    for off, is_known in (((0.3, -0.3, -0.25), True), ((0.0, 0.0, 1.0), False), ((100.0, 0.0, 0.0), False)):
        assert keyframes.know(beams_of(stops[-1]), true + np.array(off), wheels) is is_known


def test_the_alignment_of_an_estimator_asks_its_map(monkeypatch: pytest.MonkeyPatch, stops: list[Stop]) -> None:
    asked = []
    refine = Alignment.refine

    def noted(alignment: Alignment, scan: ScanLike, increment: Increment, known: Known = unknown) -> Increment:
        asked.append(known)
        return refine(alignment, scan, increment, known)

    monkeypatch.setattr(Alignment, "refine", noted)
    estimator = Estimator(SlamSettings(), 0)
    for stop in stops[:2]:
        estimator.step(stop.scan.stamp_ns, stop.scan, (stop.wheels,))
    assert [known.__func__ for known in asked] == 2 * [Keyframes.know]  # type: ignore[attr-defined]
