import math

import numpy as np
import pytest

from drivers.measurements import FloatArray, Scan, uniform_bearings
from slam.front_end.deskew import Twist, deskew
from slam.front_end.differencing import CompensatedVote, PlacedScan, Vote, equal_angle_difference
from slam.observations import BeamVerdict
from slam.pose import Pose2

BEARINGS = uniform_bearings(-math.radians(135.0), math.radians(0.25), 1081)
POST = np.array((6.0, 1.0))


def scan_of(circles: list[tuple[FloatArray, float]], pose: Pose2, stamp_s: float) -> Scan:
    """Exact ranges to circles in the map and to a room of 15 m radius around the map's origin."""
    bearing = BEARINGS + pose.heading_rad
    ray = np.stack((np.cos(bearing), np.sin(bearing)), axis=-1)
    here = np.array((pose.x_m, pose.y_m))
    along = ray @ -here
    ranges = along + np.sqrt(15.0**2 - here @ here + along**2)
    for centre, radius in circles:
        along = ray @ (centre - here)
        across = ray[:, 0] * (centre - here)[1] - ray[:, 1] * (centre - here)[0]
        hit = (np.abs(across) < radius) & (along > 0)
        ranges = np.where(hit, along - np.sqrt(np.maximum(radius**2 - across**2, 0.0)), ranges)
    return Scan(round(stamp_s * 1e9), ranges.astype(np.float32), BEARINGS, range_max_m=60.0)


def ask(vote: CompensatedVote, scan: Scan, pose: Pose2, feature: FloatArray = POST) -> Vote:
    beams = deskew(scan, Twist(), Pose2(), 0.1, 60.0)
    in_laser = pose.inverse().transform(feature[None])
    return vote.ask(PlacedScan(beams, in_laser, pose))


def toward(point: FloatArray, pose: Pose2) -> int:
    x, y = pose.inverse().transform(point[None])[0]
    return int(np.argmin(np.abs(BEARINGS - math.atan2(y, x))))


def turning(number: int) -> Pose2:
    return Pose2(0.05 * number, 0.0, 0.05 * number)


def test_on_a_turning_rover_the_vote_keeps_a_post_and_the_printed_form_loses_it() -> None:
    vote = CompensatedVote()
    scans = [scan_of([(POST, 0.04)], turning(i), 0.1 * i) for i in range(12)]
    answers = [ask(vote, scan, turning(i)) for i, scan in enumerate(scans)]
    beam = toward(POST, turning(11))
    assert answers[-1].voters == 5
    assert answers[-1].found_again[0] == 5
    assert answers[-1].verdicts[beam] == BeamVerdict.KEPT
    assert equal_angle_difference(scans[11], scans[10], 0.1)[beam] == BeamVerdict.MOVED


def test_somebody_walking_is_moved_and_the_wall_he_uncovers_is_kept() -> None:
    vote = CompensatedVote()
    for i in range(12):
        walker = np.array((5.0, -1.0 + 0.12 * i))
        answer = ask(vote, scan_of([(walker, 0.25)], Pose2(), 0.1 * i), Pose2(), walker)
    body = slice(toward(walker, Pose2()) - 8, toward(walker, Pose2()) + 9)
    assert (answer.verdicts[body] == BeamVerdict.MOVED).all()
    assert answer.found_again[0] == 0
    uncovered = toward(np.array((5.0, -1.0 + 0.12 * 3)), Pose2())
    assert answer.verdicts[uncovered] in (BeamVerdict.KEPT, BeamVerdict.NOT_COMPARED)
    assert (answer.verdicts[:300] == BeamVerdict.KEPT).all()


def test_a_place_that_was_hidden_until_now_is_not_compared() -> None:
    vote = CompensatedVote()
    screen = (np.array((3.0, 0.5)), 0.3)
    for i in range(11):
        ask(vote, scan_of([(POST, 0.1), screen], Pose2(), 0.1 * i), Pose2())
    answer = ask(vote, scan_of([(POST, 0.1)], Pose2(), 1.1), Pose2())
    assert answer.verdicts[toward(POST, Pose2())] == BeamVerdict.NOT_COMPARED


def test_a_place_outside_the_earlier_view_is_not_compared() -> None:
    vote = CompensatedVote()
    for i in range(11):
        ask(vote, scan_of([], Pose2(), 0.1 * i), Pose2())
    turned = Pose2(0.0, 0.0, math.radians(60.0))
    answer = ask(vote, scan_of([], turned, 1.1), turned)
    assert (answer.verdicts[-200:] == BeamVerdict.NOT_COMPARED).all()
    assert (answer.verdicts[:800] == BeamVerdict.KEPT).all()


def test_scans_seconds_apart_have_no_voters() -> None:
    vote = CompensatedVote()
    for i in range(5):
        answer = ask(vote, scan_of([], Pose2(), 3.0 * i), Pose2())
        assert answer.voters == 0
        assert (answer.verdicts == BeamVerdict.NOT_COMPARED).all()


def test_time_that_stands_still_or_runs_backwards_is_survived_and_forgets_the_past() -> None:
    vote = CompensatedVote()
    for stamp in (0.0, 0.5, 1.0, 1.0, 1.0):
        answer = ask(vote, scan_of([], Pose2(), stamp), Pose2())
    assert answer.voters == 2
    assert ask(vote, scan_of([], Pose2(), 0.2), Pose2()).voters == 0
    assert ask(vote, scan_of([], Pose2(), 0.7), Pose2()).voters == 1


@pytest.mark.parametrize("count", [0, 1, 500, 1081])
def test_scans_of_any_number_of_beams_can_follow_each_other(count: int) -> None:
    vote = CompensatedVote()
    for i in range(11):
        size = count if i % 2 else 1081
        bearings = uniform_bearings(-1.0, 0.002, size)
        scan = Scan(i * 100_000_000, np.full(size, 5.0, dtype=np.float32), bearings)
        beams = deskew(scan, Twist(), Pose2(), 0.1, 60.0)
        answer = vote.ask(PlacedScan(beams, np.empty((0, 2)), Pose2()))
        assert answer.verdicts.shape == (size,)


def test_the_printed_difference_compares_equal_beams_of_two_scans() -> None:
    before = Scan(0, np.array((1.0, 2.0, np.nan, 4.0), dtype=np.float32), BEARINGS[:4].copy())
    now = Scan(1, np.array((1.05, 2.2, 3.0, np.nan), dtype=np.float32), BEARINGS[:4].copy())
    kept, moved, nothing = BeamVerdict.KEPT, BeamVerdict.MOVED, BeamVerdict.NO_RETURN
    assert equal_angle_difference(now, before, 0.1).tolist() == [kept, moved, moved, nothing]
    alone = [BeamVerdict.NOT_COMPARED] * 3 + [nothing]
    assert equal_angle_difference(now, None, 0.1).tolist() == alone
    other = Scan(0, np.ones(3, dtype=np.float32), BEARINGS[:3].copy())
    assert equal_angle_difference(now, other, 0.1).tolist() == alone
