import numpy as np
import pytest

from slam.pose import Pose2
from slam.recognise.attempt import Hypothesis
from slam.recognise.confirmation import Confirmation

STEP = Pose2(5.0, 0.0, 0.2)
HERE = Pose2(30.0, -8.0, 1.0)
AFTER = HERE @ STEP


def hypothesis(pose: Pose2, known: range, odds: float = 19.0, mirror_odds: float = 0.0) -> Hypothesis:
    matched = np.array(known)
    return Hypothesis(pose, odds, mirror_odds, matched, matched, len(matched) + 2)


@pytest.mark.parametrize(
    ("second", "confirmed"),
    [
        (hypothesis(AFTER, range(3, 11)), True),
        (hypothesis(AFTER, range(2, 10)), False),  # two landmarks that the first did not have
        (hypothesis(AFTER @ Pose2(2.5, 0.0, 0.0), range(3, 11)), False),
        (hypothesis(AFTER @ Pose2(0.0, 0.0, 0.15), range(3, 11)), False),
        (hypothesis(AFTER, range(3, 11), odds=13.0), False),
        (hypothesis(AFTER, range(3, 11), odds=20.0, mirror_odds=16.0), False),
        (hypothesis(AFTER, range(3, 8)), False),  # five matches
    ],
)
def test_a_place_is_confirmed_by_agreement_and_new_evidence(second: Hypothesis, confirmed: bool) -> None:
    confirmation = Confirmation()
    assert not confirmation.add(hypothesis(HERE, range(8)), Pose2())
    assert confirmation.add(second, STEP) is confirmed


def test_the_same_evidence_again_confirms_nothing_however_often_it_comes() -> None:
    confirmation = Confirmation()
    assert not any(confirmation.add(hypothesis(HERE, range(8)), Pose2()) for _ in range(10))


def test_what_was_withheld_from_one_attempt_is_new_evidence_for_the_next() -> None:
    confirmation = Confirmation()
    assert not confirmation.add(hypothesis(HERE, range(9)), Pose2())
    assert not confirmation.add(hypothesis(HERE, range(6)), Pose2())
    assert confirmation.add(hypothesis(HERE, range(9)), Pose2())


def test_a_place_that_disagrees_becomes_the_first_of_two() -> None:
    confirmation = Confirmation()
    confirmation.add(hypothesis(Pose2(), range(8)), Pose2())
    assert not confirmation.add(hypothesis(HERE, range(20, 28)), Pose2())
    assert confirmation.add(hypothesis(AFTER, range(23, 31)), STEP)


def test_one_attempt_is_enough_where_three_of_its_matches_could_have_been_withheld() -> None:
    assert Confirmation().add(hypothesis(HERE, range(9), odds=20.0), Pose2())
    assert not Confirmation().add(hypothesis(HERE, range(8), odds=40.0), Pose2())
    assert not Confirmation().add(hypothesis(HERE, range(9), odds=20.0, mirror_odds=16.0), Pose2())
    assert not Confirmation().add(hypothesis(HERE, range(9), odds=19.9), Pose2())


def test_a_first_attempt_names_the_place_long_before_it_could_be_believed() -> None:
    confirmation = Confirmation()
    assert not confirmation.add(hypothesis(HERE, range(4), odds=3.0), Pose2())
    assert not confirmation.add(hypothesis(HERE, range(6), odds=19.0), Pose2())
    assert confirmation.add(hypothesis(HERE, range(7), odds=19.0), Pose2())


def test_what_is_hardly_more_probable_than_nothing_names_no_place() -> None:
    confirmation = Confirmation()
    assert not confirmation.add(hypothesis(HERE, range(4), odds=2.9), Pose2())
    assert not confirmation.add(hypothesis(HERE, range(7), odds=19.0), Pose2())


def test_a_place_that_was_named_with_more_is_not_forgotten_for_one_with_less() -> None:
    confirmation = Confirmation()
    confirmation.add(hypothesis(HERE, range(4), odds=9.0), Pose2())
    assert not confirmation.add(hypothesis(Pose2(), range(20, 24), odds=8.0), Pose2())
    assert confirmation.add(hypothesis(HERE, range(7)), Pose2())
