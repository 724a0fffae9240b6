import numpy as np
import pytest

from slam.observations import IDENTITIES_PER_SCAN
from slam.relocalise.rooting import Rooting

OLD, NEW = 3 * IDENTITIES_PER_SCAN, 40 * IDENTITIES_PER_SCAN


def rooting() -> Rooting:
    """Thirty scans are rooted."""
    rooted = Rooting()
    rooted.add(30, np.arange(5), 5, 2)
    return rooted


@pytest.mark.parametrize(
    ("matched", "scans", "rooted"),
    [
        ([OLD, OLD + 1, OLD + 2, NEW], 3, True),
        ([OLD, OLD + 1, OLD + 2, NEW], 2, False),
        ([OLD, OLD + 1, OLD + 2, NEW, NEW + 1], 9, False),  # three of five
        ([OLD, OLD + 1], 9, False),
        ([OLD, OLD + 1, OLD + 2, -1, -2, -3], 3, True),  # verdicts are no matches
    ],
)
def test_support_of_the_rooted_map_roots_what_was_made_since(matched: list[int], scans: int, rooted: bool) -> None:
    rule = rooting()
    for scan in range(50, 50 + scans):
        rule.add(scan, np.array(matched), 100, 7)
    assert bool(rule.is_rooted(np.array([NEW]))[0]) is rooted
    assert rule.keyframes == (7 if rooted else 2)
    assert rule.is_rooted(np.array([OLD])).all()


def test_a_scan_without_support_breaks_the_row() -> None:
    rule = rooting()
    for matched in ([OLD, OLD + 1, OLD + 2], [OLD, OLD + 1, OLD + 2], [NEW], [OLD, OLD + 1, OLD + 2]):
        rule.add(60, np.array(matched), 100, 7)
    assert rule.before_scan == 30


def test_a_map_that_was_empty_for_long_begins_with_its_first_landmarks_however_many() -> None:
    """A rover that stands maps nothing; with the first metre it drives all that it sees comes at once."""
    rule = Rooting()
    for scan in range(1, 20):
        assert rule.add(scan, np.empty(0, dtype=np.int64), 0, 0)
    assert rule.add(20, np.full(30, -1), 30, 1)
    assert rule.is_rooted(np.array([19 * IDENTITIES_PER_SCAN])).all()
    assert not rule.add(21, np.full(30, -1), 60, 2)
