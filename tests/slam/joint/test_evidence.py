import numpy as np
import pytest

from drivers.measurements import BoolArray
from slam.joint.evidence import (
    FIRST_FINDS_AFTER_MISS,
    FIRST_LOOKS_AFTER_MISS,
    MOST_OF_A_SCAN,
    DetectionRates,
    Evidence,
    InView,
    score,
)
from slam.joint.measurement import FIRST_PLACE, JointArrays
from slam.observations import NO_FEATURES
from slam.settings.slam import SlamSettings
from slam.visibility import CHANCE, SightLine
from tests.slam.joint.test_gaussian import features_at

TUNING = SlamSettings().tuning()
POINTS = [(5.0, 0.0), (5.0, 3.0), (5.0, -3.0)]
OPEN = SightLine(-2.0, 4.0 / 400, 30.0, np.full(401, np.nan))


def rates(count: int) -> DetectionRates:
    after_miss = np.array((FIRST_LOOKS_AFTER_MISS, FIRST_FINDS_AFTER_MISS))
    return DetectionRates(np.zeros(count), np.zeros(count), np.zeros(count, dtype=np.bool_), after_miss, True)


def scan_of(
    found: bool,
    learnt: DetectionRates,
    sight: SightLine = OPEN,
    points: list[tuple[float, float]] = POINTS,
    undecided: BoolArray | None = None,
) -> Evidence:
    mean = np.concatenate((np.zeros(FIRST_PLACE), np.ravel(points)))
    joint = JointArrays(mean, 1e-4 * np.eye(len(mean)), len(mean), np.zeros(3))
    places = FIRST_PLACE + 2 * np.arange(len(points))
    settled = np.ones(len(points), dtype=np.bool_)
    features = features_at(points) if found else NO_FEATURES
    chosen = np.arange(len(points)) if found else np.zeros(0, dtype=np.int64)
    in_view = InView(places, settled, np.zeros(len(points), dtype=np.bool_) if undecided is None else undecided)
    return score(joint, in_view, features, chosen, sight, learnt, TUNING)


def test_what_is_always_found_speaks_loudly_when_it_is_missed() -> None:
    fresh, learnt = rates(3), rates(3)
    for _ in range(50):
        scan_of(True, learnt)
    assert scan_of(False, learnt).against > 2.0 * scan_of(False, fresh).against > 0.0


def test_looks_from_one_place_count_once() -> None:
    """A rover that stood for a minute has seen its landmarks from one side only."""
    standing, driving = rates(3), rates(3)
    for _ in range(50):
        scan_of(True, standing._replace(from_elsewhere=False))
        scan_of(True, driving)
    fresh = scan_of(False, rates(3)).against
    assert scan_of(False, standing).against == pytest.approx(fresh)
    assert scan_of(False, driving).against > 2.0 * fresh


def test_what_is_missed_while_the_rover_stands_is_missed_once() -> None:
    """A door that opened is no news a second later."""
    learnt = rates(1)._replace(from_elsewhere=False)
    first, second = (scan_of(False, learnt, points=POINTS[:1]).against for _ in range(2))
    assert second < 0.5 * first


def test_what_may_be_seen_but_is_not_matched_is_not_missed() -> None:
    certain, undecided = (
        scan_of(False, rates(3), undecided=np.array((False, *[where] * 2))) for where in (False, True)
    )
    assert (certain.missed, undecided.missed) == (3, 1)
    assert 0.0 < undecided.against < 0.5 * certain.against


def test_what_is_rarely_found_says_nothing_when_it_is_missed() -> None:
    learnt = rates(3)
    for _ in range(200):
        scan_of(False, learnt)
    assert scan_of(False, learnt).against == pytest.approx(0.0, abs=0.3)


def test_a_corner_that_is_seen_no_more_costs_no_more_than_a_few_misses() -> None:
    learnt = rates(1)
    for _ in range(50):
        scan_of(True, learnt, points=POINTS[:1])
    total = sum(scan_of(False, learnt, points=POINTS[:1]).against for _ in range(10))
    assert 3.0 < total < 8.0


def test_found_landmarks_speak_for_the_pose_and_one_scan_never_decides_alone() -> None:
    learnt = rates(3)
    assert scan_of(True, learnt).against == pytest.approx(3.0 * np.log(CHANCE / 0.75))
    many = [(5.0, 0.2 * number) for number in range(-20, 20)]
    learnt = rates(len(many))
    for _ in range(50):
        scan_of(True, learnt, points=many)
    assert scan_of(False, learnt, points=many).against == MOST_OF_A_SCAN


def test_a_landmark_behind_a_wall_is_not_known_in_view() -> None:
    wall = OPEN._replace(ranges_m=np.full(401, 2.0))
    assert scan_of(False, rates(3), wall).known == 0
    covered = OPEN._replace(ranges_m=np.zeros(401))
    evidence = scan_of(False, rates(3), covered)
    assert (evidence.known, evidence.missed) == (3, 0)
