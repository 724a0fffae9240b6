import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.measurements import FloatArray, Scan, Sightings
from drivers.settings.simulated_world import WorldSettings
from runtime.studies.loss_detection.drives import simulated_ticks
from slam.estimator import Estimator
from slam.front_end import alignment_search
from slam.front_end.alignment import LAID_ALONE_M, WALLS_ALONE_M, Alignment
from slam.front_end.alignment_kernels import EarlierScans
from slam.front_end.alignment_search import Search
from slam.front_end.deskew import Beams
from slam.odometry.odometry import Increment, Odometry
from slam.pose import Pose2
from slam.settings.front_end import FrontEndSettings
from slam.settings.odometry import OdometrySettings
from slam.settings.slam import SlamSettings
from tests.support.slam.corridor import BEARINGS_RAD, Stop, drive_round, ranges_of, ring_of_corridors

SECOND_NS = 1_000_000_000
MOUNT = Pose2(0.1, 0.0, 0.0)
WHEELS = OdometrySettings(
    model="pose",
    slip_m_per_sqrt_m=0.06,
    lateral_m_per_sqrt_m=0.02,
    heading_rad_per_sqrt_m=0.05,
    heading_rad_per_sqrt_rad=0.08,
    gap_s=4.0,
)
SURE = Increment(np.array((0.05, 0.0, 0.01)), np.diag((1e-3, 1e-3, 2e-3)) ** 2, False, True, 0.1, 0.5, 0.0, 0.1, 0.1)
MOVED = Increment(
    np.array((0.5, 0.0, 0.1)), np.diag((0.05**2, 0.02**2, 0.06**2)), False, True, 3.0, 0.2, 0.0, 0.03, 3.0
)


def settings_of(**alignment: object) -> FrontEndSettings:
    return FrontEndSettings.model_validate({"range_max_m": 20.0, "width_max_m": 0.4, "alignment": alignment})


def refined(stops: list[Stop], settings: FrontEndSettings) -> tuple[list[Increment], list[Increment], Alignment]:
    """Increments as the wheels give them, the same after alignment, and the aligner."""
    odometry, alignment = Odometry(WHEELS), Alignment(settings, MOUNT)
    raw, better = [], []
    for stop in stops:
        odometry.add((stop.wheels,))
        raw.append(odometry.take_until(stop.scan.stamp_ns))
        better.append(alignment.refine(stop.scan, raw[-1]))
    return raw, better, alignment


def errors_of(stops: list[Stop], increments: list[Increment]) -> FloatArray:
    """(n - 1, 3) true motion ^-1 (+) increment, from the second stop on."""
    errors = []
    for before, after, increment in zip(stops, stops[1:], increments[1:], strict=False):
        true = before.map_from_body.inverse() @ after.map_from_body
        errors.append((true.inverse() @ increment.as_pose()).as_array())
    return np.array(errors)


@pytest.fixture(scope="module")
def stops() -> list[Stop]:
    return drive_round(1, 1.1, MOUNT)


def test_scans_seconds_apart_correct_the_wheels_tenfold(stops: list[Stop]) -> None:
    raw, better, alignment = refined(stops, settings_of())
    assert alignment.refined >= len(stops) - 2
    wheels, aligned = errors_of(stops, raw), errors_of(stops, better)
    assert np.sqrt((wheels[:, 2] ** 2).mean()) > 10.0 * np.sqrt((aligned[:, 2] ** 2).mean())
    assert np.hypot(aligned[:, 0], aligned[:, 1]).max() < 0.1
    assert np.abs(aligned[:, 2]).max() < 0.01


def test_the_covariance_of_a_refined_increment_is_honest(stops: list[Stop]) -> None:
    """Normalised squares of 3 degrees of freedom: not above 3, as wide as half of the beams say."""
    _, better, _ = refined(stops, settings_of())
    squares = [
        error @ np.linalg.solve(increment.covariance, error)
        for error, increment in zip(errors_of(stops, better), better[1:], strict=True)
    ]
    assert 0.2 < np.mean(squares) < 3.0
    assert max(squares) < 16.3  # 99.9 % of chi-square with 3


def test_good_wheels_are_left_alone_where_scans_can_be_voted_on(stops: list[Stop]) -> None:
    alignment, before = Alignment(settings_of(), MOUNT), stops[0].map_from_body
    for number, stop in enumerate(stops[:12]):
        scan = replace(stop.scan, stamp_ns=number * 100_000_000)
        sure = replace(SURE, mean=(before.inverse() @ stop.map_from_body).as_array())
        assert alignment.refine(scan, sure) is sure
        before = stop.map_from_body
    assert alignment.refined == 0


@pytest.mark.parametrize(("seen_rad", "least", "most"), [(6.0, 2, 5), (0.8, 0, 0)])
def test_good_wheels_that_add_up_are_laid_onto_keyframes_where_enough_is_seen(
    stops: list[Stop], seen_rad: float, least: int, most: int
) -> None:
    """At 10 Hz no increment is ever off by much, and a lap of a building drifted by a degree all the same. What fills
    less of the view than a radian, as people in the open do, is laid onto nothing.
    """
    alignment, laid, before = Alignment(settings_of(), MOUNT), [], stops[0].scan
    ranges = np.where(np.abs(before.bearings_rad - 0.6) < 0.5 * seen_rad, before.ranges_m, np.nan).astype(np.float32)
    for number in range(60):
        scan = replace(before, stamp_ns=number * 100_000_000, ranges_m=ranges)
        alignment.refine(scan, replace(SURE, mean=np.zeros(3)))
        laid.append(alignment.laid is not None)
        if number:
            assert alignment.alone_m == WALLS_ALONE_M, "laid or not, the wheels are good"
        assert alignment.is_due == laid[-1]
    assert alignment.refined == 0
    assert least <= sum(laid) <= most


def test_walls_that_one_scan_shows_badly_keep_a_landmark_from_moving_the_pose_alone(stops: list[Stop]) -> None:
    """In a corridor seen by 181 beams now and then a fifth of the returns lies on no surface. In one such scan a single
    landmark, known to a metre, moved the pose by 1.1 m. Only after a way is the scan forgotten that showed walls.
    """
    alignment, before = Alignment(settings_of(), MOUNT), stops[0].scan
    bad = np.where(np.arange(before.ranges_m.size) % 2 == 0, before.ranges_m, 0.9 * before.ranges_m).astype(np.float32)
    alone_m = []
    for number in range(40):
        ranges = before.ranges_m if number < 10 else bad
        scan = replace(before, stamp_ns=number * 100_000_000, ranges_m=ranges)
        alignment.refine(scan, replace(SURE, mean=np.zeros(3)))
        alone_m.append(alignment.alone_m)
    assert alone_m[0] == math.inf
    assert set(alone_m[1:13]) == {WALLS_ALONE_M}
    assert set(alone_m[-5:]) == {math.inf}


@pytest.mark.parametrize(("yaw_rate", "period_s", "farther"), [(0.0, 0.0, True), (3.0, 0.0, False), (3.0, 1e-4, True)])
def test_what_a_turn_blurs_is_not_laid(stops: list[Stop], yaw_rate: float, period_s: float, farther: bool) -> None:
    """At 3 rad/s and with beams that nobody has timed, a return at 5 m may stand 0.15 m beside its place."""
    alignment, scans = (
        Alignment(settings_of(), MOUNT),
        [replace(stop.scan, beam_period_s=period_s) for stop in stops[:3]],
    )
    for scan in scans:
        alignment.refine(scan, replace(MOVED, yaw_rate_radps=yaw_rate))
    assert alignment.laid is not None or not farther
    seen = alignment._past[-1].beams
    assert seen is not None
    assert bool(np.nanmax(seen.ranges_m) > 5.1) is farther
    assert np.nanmax(scans[-1].ranges_m[np.isfinite(scans[-1].ranges_m)]) > 6.0


def test_wheels_that_may_err_by_more_than_things_lie_apart_are_corrected_at_any_rate() -> None:
    stops = drive_round(1, 0.2, MOUNT, 100_000_000)
    raw, better, alignment = refined(stops, settings_of())
    assert alignment.refined >= len(stops) - 2
    wheels, aligned = errors_of(stops, raw), errors_of(stops, better)
    assert np.abs(aligned[:, 2].sum()) < 0.2 * max(np.abs(wheels[:, 2].sum()), 0.05)


def test_after_a_gap_the_next_scans_are_aligned_and_then_no_more(
    stops: list[Stop], monkeypatch: pytest.MonkeyPatch
) -> None:
    for need in ("NEED_M", "NEED_AMONG_WALLS_M", "UNUSUAL_SHARE"):
        monkeypatch.setattr(f"slam.front_end.alignment.{need}", math.inf)  # only the gap counts here
    alignment = Alignment(settings_of(), MOUNT)
    counts, stamp_ns = [], 0
    for number, stop in enumerate(stops[:12]):
        stamp_ns += 5_000_000_000 if number == 6 else 100_000_000
        alignment.refine(replace(stop.scan, stamp_ns=stamp_ns), MOVED)
        counts.append(alignment.refined)
    assert counts[5] == 0
    assert counts[6:8] == [1, 2]
    assert counts[-1] == 2


def test_a_slip_that_the_wheels_do_not_own_up_to_is_found_and_small_errors_are_not_touched(stops: list[Stop]) -> None:
    """The wheels claim 0.06 deg; ten steps are true, then the rover turns by 9 deg and they say nothing of it."""
    alignment, stamp_ns, lines, pose = Alignment(settings_of(), MOUNT), 0, ring_of_corridors(1), stops[0].map_from_body
    for step in range(11):
        turn_rad = math.radians(9.0) if step == 10 else 0.0
        pose = pose @ Pose2(0.01, 0.0, turn_rad)
        stamp_ns += 100_000_000
        ranges = ranges_of(pose @ MOUNT, lines).astype(np.float32)
        claimed = replace(SURE, mean=np.array((0.01, 0.0, 0.0)))
        told = alignment.refine(replace(stops[0].scan, stamp_ns=stamp_ns, ranges_m=ranges), claimed)
        if step < 10:
            assert np.array_equal(told.mean, claimed.mean)
    assert told.mean[2] == pytest.approx(math.radians(9.0), abs=0.01)


def test_a_rover_moves_no_faster_than_its_wheels_roll(stops: list[Stop]) -> None:
    """What seems to slide by 0.2 m in a tenth of a second is people who walk past: in the open they fill a scan."""
    alignment, lines, pose = Alignment(settings_of(), MOUNT), ring_of_corridors(1), stops[0].map_from_body
    claimed = replace(SURE, mean=np.array((0.02, 0.0, 0.0)))
    for step in range(11):
        pose = pose @ Pose2(0.02, 0.2 if step == 10 else 0.0, 0.0)
        ranges = ranges_of(pose @ MOUNT, lines).astype(np.float32)
        told = alignment.refine(replace(stops[0].scan, stamp_ns=100_000_000 * step, ranges_m=ranges), claimed)
        assert told.mean is claimed.mean


@pytest.mark.parametrize(("before", "says_so"), [(3, False), (12, True)])
def test_a_scan_that_fits_nowhere_says_so_where_walls_have_been_seen_for_a_while(
    stops: list[Stop], before: int, says_so: bool
) -> None:
    """Between bushes a scan or two look like walls, too."""
    alignment, lines, pose = Alignment(settings_of(), MOUNT), ring_of_corridors(1), stops[0].map_from_body
    claimed = replace(SURE, mean=np.array((0.02, 0.0, 0.0)))
    for step in range(before + 1):
        assert not alignment.is_torn
        pose = pose @ (Pose2(5.0, 0.4, 1.2) if step == before else Pose2(0.02, 0.0, 0.0))
        ranges = ranges_of(pose @ MOUNT, lines).astype(np.float32)
        alignment.refine(replace(stops[0].scan, stamp_ns=100_000_000 * step, ranges_m=ranges), claimed)
    assert alignment.is_torn == says_so


def test_where_neither_wheels_nor_scan_are_clearly_right_either_may_be(stops: list[Stop]) -> None:
    """Six beams in ten say that the rover turned by 12 deg, four see a new place; the wheels are sure of no turn."""
    alignment, lines, pose = Alignment(settings_of(), MOUNT), ring_of_corridors(1), stops[0].map_from_body
    claimed = replace(MOVED, mean=np.array((0.1, 0.0, 0.0)), covariance=np.diag((0.02, 0.01, 0.01)) ** 2)
    for step in range(8):
        pose = pose @ Pose2(0.1, 0.0, math.radians(12.0) if step == 7 else 0.0)
        ranges = ranges_of(pose @ MOUNT, lines).astype(np.float32)
        if step == 7:
            ranges[np.arange(ranges.size) % 10 < 4] = 18.0
        told = alignment.refine(replace(stops[0].scan, stamp_ns=3 * SECOND_NS * step, ranges_m=ranges), claimed)
    assert told.mean is claimed.mean
    assert alignment.laid is None
    assert alignment.alone_m == LAID_ALONE_M
    assert math.sqrt(told.covariance[2, 2]) > 0.1


def test_what_the_map_knows_where_the_wheels_say_is_not_looked_for_far_from_there(stops: list[Stop]) -> None:
    """A room that looks the same turned by 80 deg, after two scans that were lost: the map has more than one scan."""
    lines, pose = ring_of_corridors(1), stops[0].map_from_body
    claimed = replace(MOVED, mean=np.array((0.1, 0.0, 0.0)), covariance=np.diag((0.02, 0.02, 0.03)) ** 2)
    asked: list[FloatArray] = []
    for knows in (False, True):
        alignment = Alignment(settings_of(), MOUNT)

        def known(_beams: Beams, motion: FloatArray, covariance: FloatArray, knows: bool = knows) -> bool:
            asked.append(np.concatenate((motion, np.sqrt(np.diag(covariance)))))
            return knows

        for step, turn_deg in enumerate((0.0, 0.0, 0.0, 0.0, 60.0)):
            pose_now = pose @ Pose2(0.1 * step, 0.0, math.radians(turn_deg))
            ranges = ranges_of(pose_now @ MOUNT, lines).astype(np.float32)
            told = alignment.refine(
                replace(stops[0].scan, stamp_ns=3 * SECOND_NS * step, ranges_m=ranges), claimed, known
            )
        assert alignment.found_widely == (0 if knows else 1)
        assert (abs(told.mean[2] - math.radians(60.0)) < 0.05) == (not knows)
    assert np.allclose(asked[-1][:3], claimed.mean)
    assert (asked[-1][3:] >= np.sqrt(np.diag(claimed.covariance))).all()


def test_turns_that_the_wheels_miss_one_soon_after_the_other_are_found(stops: list[Stop]) -> None:
    """Stamps of a log that come in bursts: 25 deg one way and 13 deg back, 0.4 s apart, not told by the wheels."""
    alignment, stamp_ns, lines, pose = Alignment(settings_of(), MOUNT), 0, ring_of_corridors(1), stops[0].map_from_body
    claimed = replace(MOVED, mean=np.array((0.1, 0.0, 0.0)), covariance=np.diag((0.02, 0.01, 0.015)) ** 2)
    for turn_deg in (*[0.0] * 10, -25.0, 13.0):
        pose = pose @ Pose2(0.1, 0.0, math.radians(turn_deg))
        stamp_ns += 400_000_000
        ranges = ranges_of(pose @ MOUNT, lines).astype(np.float32)
        told = alignment.refine(replace(stops[0].scan, stamp_ns=stamp_ns, ranges_m=ranges), claimed)
        if stamp_ns > 400_000_000:
            assert told.mean[2] == pytest.approx(math.radians(turn_deg), abs=0.02)
            assert alignment.laid is not None, "so that no single landmark closes a loop after it"


@pytest.mark.parametrize(
    ("seed", "stop", "wrong_deg", "claimed_rad"), [(1, 19, 8.0, 0.01), (1, 39, 8.0, 0.01), (2, 36, 8.0, 0.006)]
)
def test_wheels_that_are_sure_of_a_wrong_turn_do_not_hold_the_scan_to_it(
    seed: int, stop: int, wrong_deg: float, claimed_rad: float
) -> None:
    """Held half way between both, it lies on walls with most of its points, and is believed."""
    assert abs(last_error(range(stop - 12, stop + 1), seed, wrong_deg, claimed_rad, 0.0)[2]) < 0.02


@pytest.mark.parametrize(("seed", "stop", "wrong_deg"), [(1, 37, 8.0), (1, 41, 6.0)])
def test_earlier_scans_that_see_little_of_the_place_do_not_make_wrong_wheels_right(
    seed: int, stop: int, wrong_deg: float
) -> None:
    """Round a corner, scans 1.4 m apart have a third of the points in common."""
    assert abs(last_error(range(stop - 24, stop + 1, 2), seed, wrong_deg, 0.015, 0.2)[2]) < 0.02


@pytest.mark.parametrize(("stop", "wrong_deg", "wrong_m"), [(32, 5.0, -0.7), (53, 10.0, -0.6)])
def test_a_slip_of_half_a_step_and_more_is_found(stop: int, wrong_deg: float, wrong_m: float) -> None:
    """A scan was lost, and stamps came in a burst."""
    numbers = range(stop - 24, stop + 1, 2)
    error = last_error(numbers, 1, wrong_deg, 0.02, wrong_m, wrong_m_left=0.06, claimed_m=(0.03, 0.02))
    assert np.abs(error).max() < 0.05


def last_error(
    numbers: range,
    seed: int,
    wrong_deg: float,
    claimed_rad: float,
    wrong_m: float,
    wrong_m_left: float = 0.0,
    claimed_m: tuple[float, float] = (0.02, 0.01),
) -> FloatArray:
    """(3,) of the motion to the last of these stops, where the wheels are wrong; before it they are right."""
    everywhere = drive_round(seed, 1.0, MOUNT)
    driven = [everywhere[number] for number in numbers]
    alignment, before = Alignment(settings_of(), MOUNT), driven[0]
    for stop in driven:
        true = (before.map_from_body.inverse() @ stop.map_from_body).as_array()
        wrong = np.array((wrong_m, wrong_m_left, math.radians(wrong_deg)))
        error = wrong if stop is driven[-1] else np.zeros(3)
        claimed = np.diag((*claimed_m, claimed_rad)) ** 2
        told = alignment.refine(stop.scan, replace(MOVED, mean=true + error, covariance=claimed))
        before = stop
    return told.mean - true


def test_at_rest_and_switched_off_nothing_changes(stops: list[Stop]) -> None:
    still = replace(MOVED, mean=np.zeros(3), at_rest=True)
    again = [replace(stops[0].scan, stamp_ns=number * 100_000_000) for number in range(4)]
    moving = [stop.scan for stop in stops[:4]]
    for settings, increment, scans in ((settings_of(), still, again), (settings_of(enabled=False), MOVED, moving)):
        alignment = Alignment(settings, MOUNT)
        assert all(alignment.refine(scan, increment) is increment for scan in scans)


def test_a_straight_bare_corridor_says_nothing_of_the_way_along_it() -> None:
    lines = np.array(((-100.0, 1.2, 100.0, 1.2), (-100.0, -1.2, 100.0, -1.2)))
    alignment = Alignment(settings_of(), Pose2())
    generator, pose, increment = np.random.default_rng(3), Pose2(), MOVED
    for number in range(4):
        ranges = ranges_of(pose, lines) + generator.normal(0.0, 0.015, BEARINGS_RAD.size)
        measured: NDArray[np.float32] = np.where(ranges < 15.0, ranges, np.nan).astype(np.float32)
        increment = alignment.refine(Scan(number * 3_000_000_000, measured, BEARINGS_RAD, range_max_m=15.0), MOVED)
        pose = pose @ Pose2(0.5, 0.0, 0.0)
    assert alignment.refined == 3
    assert abs(increment.mean[2]) < 0.02  # the wheels say 0.1
    assert math.sqrt(increment.covariance[2, 2]) < 0.01
    assert increment.covariance[0, 0] > 0.8 * MOVED.covariance[0, 0]


def test_what_cannot_be_aligned_leaves_the_wheels_as_they_were(stops: list[Stop]) -> None:
    """No return, another number of beams, a place never seen (the wheels may have slipped), wheels that are not finite,
    sightings.
    """
    first = stops[0].scan
    nothing = np.full(first.ranges_m.shape, np.nan, dtype=np.float32)
    later = 5_000_000_000
    strange = Scan(later, np.full(90, 3.0, dtype=np.float32), BEARINGS_RAD[::2], range_max_m=20.0)
    elsewhere = Scan(later, np.full(180, 19.0, dtype=np.float32), BEARINGS_RAD, range_max_m=20.0)
    for scan in (replace(first, stamp_ns=later, ranges_m=nothing), strange, elsewhere):
        alignment = Alignment(settings_of(), MOUNT)
        alignment.refine(first, MOVED)
        assert alignment.refine(scan, MOVED).mean is MOVED.mean
    few = np.full(180, 19.0, dtype=np.float32)
    few[:40] = first.ranges_m[:40]  # 40 of 180 beams are where they were
    slow, alignment = replace(MOVED, mean=np.array((0.01, 0.0, 0.0))), Alignment(settings_of(), MOUNT)
    alignment.refine(first, slow)
    assert alignment.refine(replace(first, stamp_ns=later, ranges_m=few), slow).mean is slow.mean
    alignment = Alignment(settings_of(), MOUNT)
    alignment.refine(first, MOVED)
    endless = replace(MOVED, covariance=np.full((3, 3), np.nan))
    assert alignment.refine(replace(first, stamp_ns=later), endless) is endless
    sightings = Sightings(later, np.ones(2), np.zeros(2), np.full(2, -1))
    assert alignment.refine(sightings, MOVED) is MOVED


def test_a_search_from_several_headings_finds_what_one_start_misses(
    stops: list[Stop], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A corner seen before and after a turn of 30 deg of which the wheels felt half."""
    monkeypatch.setattr(alignment_search, "GATE_FIRST_M", 0.3)
    for no_other in ("UNUSUAL_SHARE", "POOR_SHARE"):  # nor farther from where the wheels say
        monkeypatch.setattr(f"slam.front_end.alignment.{no_other}", math.inf)
    corner = next(k for k, stop in enumerate(stops) if abs(stop.map_from_body.heading_rad) > 0.3)
    true = (stops[corner - 1].map_from_body.inverse() @ stops[corner].map_from_body).as_array()
    misled = replace(MOVED, mean=np.array((0.0, 0.0, true[2] - 0.45)), covariance=np.diag((1e-4, 1e-4, 0.15**2)))
    gaps = {}
    for starts in (1, 3):
        monkeypatch.setattr(alignment_search, "STARTS", starts)
        alignment = Alignment(settings_of(), MOUNT)
        alignment.refine(stops[corner - 1].scan, MOVED)
        gaps[starts] = abs(alignment.refine(stops[corner].scan, misled).mean[2] - true[2])
    assert gaps[3] < 0.02
    assert gaps[1] > 0.1


def test_wheels_that_count_backwards_as_forwards_hold_a_rover_in_a_corridor_less_often_than_not() -> None:
    """0.45 m off: the walls of a corridor lie as well where such wheels say, and only its door frames do not."""
    wrong = replace(MOVED, mean=np.array((0.2, 0.0, 0.0)), covariance=np.diag((0.1, 0.02, 0.02)) ** 2, duration_s=0.25)
    gaps_m = []
    for seed in range(3):
        rng, lines = np.random.default_rng(seed), ring_of_corridors(seed)
        for x_m in np.arange(6.0, 18.0, 0.5):
            alignment = Alignment(settings_of(), MOUNT)
            for stamp_ns, at_m, increment in ((0, x_m, MOVED), (250_000_000, x_m - 0.25, wrong)):
                ranges = (ranges_of(Pose2(at_m) @ MOUNT, lines) + rng.normal(0.0, 0.01, 180)).astype(np.float32)
                better = alignment.refine(Scan(stamp_ns, ranges, BEARINGS_RAD, 0.0, 0, range_max_m=20.0), increment)
            gaps_m.append(abs(float(better.mean[0]) + 0.25))
    assert np.mean(np.array(gaps_m) < 0.05) > 0.55  # from the wheels' motion alone 0.43


def test_good_wheels_are_not_overruled_by_people_who_walk_where_nothing_else_stands() -> None:
    """A scan of people lies on the one before worse than usual whenever they walk on; that is no slip."""
    odometry, alignment = Odometry(OdometrySettings()), Alignment(FrontEndSettings(), MOUNT)
    returned = 0
    for tick in simulated_ticks(WorldSettings(seed=1, place="empty"), 30.0):
        assert tick.scan is not None
        odometry.add(tick.wheels)
        increment = odometry.take_until(tick.scan.stamp_ns)
        returned = max(returned, int(np.isfinite(tick.scan.ranges_m).sum()))
        assert alignment.refine(tick.scan, increment) is increment
    assert returned > 60  # people fill some of the view
    assert alignment.refined == 0


def test_a_walker_close_by_is_no_slip_of_the_wheels() -> None:
    """A park with hedges: what moves along with a walker lies better on the last scan, and worse on older ones."""
    world = WorldSettings(seed=3)
    odometry, alignment = (
        Odometry(OdometrySettings()),
        Alignment(FrontEndSettings(), Pose2(*world.laser.body_from_laser)),
    )
    for tick in simulated_ticks(world, 30.0):
        assert tick.scan is not None
        odometry.add(tick.wheels)
        alignment.refine(tick.scan, odometry.take_until(tick.scan.stamp_ns))
    assert alignment.refined == 0


def test_the_same_scans_give_the_same_bits(stops: list[Stop]) -> None:
    _, first, _ = refined(stops[:30], settings_of())
    _, second, _ = refined(stops[:30], settings_of())
    assert all(a.mean.tobytes() == b.mean.tobytes() for a, b in zip(first, second, strict=True))
    assert all(a.covariance.tobytes() == b.covariance.tobytes() for a, b in zip(first, second, strict=True))


def largest_error_m(stops: list[Stop], enabled: bool) -> float:
    """Of the published pose, in the frame of the start."""
    tree = {
        "particles": 20,
        "mount": {"x_m": MOUNT.x_m},
        "odometry": WHEELS,
        "front_end": settings_of(enabled=enabled),
        "view": {"range_max_m": 20.0},
    }
    estimator = Estimator(SlamSettings.model_validate(tree), 1)
    errors = []
    for stop in stops:
        pose = stops[0].map_from_body @ estimator.step(stop.scan.stamp_ns, stop.scan, (stop.wheels,)).map_from_body
        errors.append(math.hypot(pose.x_m - stop.map_from_body.x_m, pose.y_m - stop.map_from_body.y_m))
    return max(errors)


def test_a_ring_of_corridors_closes_within_half_a_metre_and_not_without_alignment(stops: list[Stop]) -> None:
    assert largest_error_m(stops, True) < 0.5
    assert largest_error_m(stops, False) > 1.0


def test_the_search_writes_finite_information() -> None:
    points = np.array(((2.0, 1.0), (3.0, 1.0), (4.0, 1.0)))
    wall, normals = points.copy()[np.newaxis], np.tile((0.0, 1.0), (3, 1))[np.newaxis]
    start = np.array(((0.0, 0.0, 1.0, 0.0),))
    search = Search(points, EarlierScans(wall, normals, start, 0.2, 0.1))
    motion, information, _ = search.best(np.zeros(3), 0.01 * np.eye(3))
    assert np.isfinite(motion).all()
    assert (np.linalg.eigvalsh(information) > 0.0).all()
