from slam.pose import Pose2
from slam.recognise.attempt import ODDS
from slam.scan_search.agreement import Agreement
from slam.scan_search.laying import Laid

AHEAD = Pose2(3.0, 0.0, 0.0)


def laid(pose: Pose2, odds: float) -> Laid:
    return Laid(pose, odds, -1.0, 0.8)


def test_stretches_that_agree_add_up_until_the_place_is_believed() -> None:
    agreement, frame, place = Agreement(), Pose2(), Pose2(20.0, 5.0, 1.0)
    assert agreement.add(laid(place, 5.0), frame) is None
    assert agreement.add(laid(place @ AHEAD, 5.0), frame @ AHEAD) is None
    found = agreement.add(laid(place @ AHEAD @ AHEAD, 5.0), frame @ AHEAD @ AHEAD)
    assert found is not None
    assert found.odds == 15.0
    assert found.map_from_body == place @ AHEAD @ AHEAD


def test_one_stretch_is_never_enough() -> None:
    agreement = Agreement()
    assert agreement.add(laid(Pose2(), 100.0), Pose2()) is None
    assert agreement.odds < ODDS
    assert agreement.add(laid(AHEAD, 100.0), AHEAD) is not None


def test_a_place_that_does_not_go_along_with_the_rover_is_not_believed() -> None:
    """The same place again and again, while the rover drives on: what looks alike there is not where it is."""
    agreement, frame = Agreement(), Pose2()
    for _ in range(20):
        assert agreement.add(laid(Pose2(4.0, 4.0, 0.0), 5.0), frame) is None
        frame = frame @ AHEAD


def test_a_stretch_that_lies_better_elsewhere_takes_its_odds_away() -> None:
    agreement = Agreement()
    agreement.add(laid(Pose2(), 6.0), Pose2())
    agreement.add(laid(AHEAD, 6.0), AHEAD)
    agreement.add(laid(Pose2(50.0, 0.0, 0.0), 2.0), AHEAD)
    assert agreement.odds == 10.0
    agreement.add(laid(Pose2(50.0, 0.0, 0.0), 7.0), AHEAD)
    assert agreement.odds == 7.0, "the better place is the one that is followed now"


def test_what_says_nothing_changes_nothing() -> None:
    agreement = Agreement()
    agreement.add(laid(Pose2(), 6.0), Pose2())
    agreement.add(laid(Pose2(9.0, 9.0, 0.0), -3.0), AHEAD)
    assert agreement.odds == 6.0
