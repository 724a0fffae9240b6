import pytest

from runtime.studies.places.outcomes import DEFAULTS, OWN, Outcome, dropped
from runtime.studies.places.targets import asked_rows


def outcome(over: float, rms_m: float, way_m: float = 30.0) -> Outcome:
    result = {"over_odometry": over, "published_rms_m": rms_m, "published_trimmed_rms_m": rms_m, "way_m": way_m}
    return Outcome(dict(result), [dict(result), {**result, "over_odometry": over + 0.1}])


def test_one_repeat_that_is_worse_than_odometry_spoils_every_place() -> None:
    outcomes = {
        ("good", OWN): outcome(0.2, 0.1),
        ("middling", OWN): outcome(0.95, 0.4),
        ("fair", OWN): outcome(0.4, 0.2),
    }
    rows = {(row["figure"], row["statistic"]): row for row in asked_rows(outcomes)}
    worst = rows["over_odometry", "worst"]
    assert (worst["place"], worst["value"], worst["reached"]) == ("every place, worst middling", 1.05, "not reached")
    assert rows["over_odometry", "median of the places"]["value"] == 0.4


def test_the_trimmed_error_may_grow_with_the_way() -> None:
    for way_m, reached in ((30.0, "not reached"), (200.0, "aim")):
        rows = asked_rows({("hall", OWN): outcome(0.5, 1.5, way_m)})
        (row,) = (row for row in rows if "1 % of the way" in row["figure"])
        assert row["reached"] == reached


def test_the_defaults_are_set_against_the_own_file_of_the_same_place() -> None:
    outcomes = {
        ("hall", OWN): outcome(0.5, 0.2),
        ("hall", DEFAULTS): outcome(0.5, 0.25),
        ("yard", OWN): outcome(0.5, 9.0),
    }
    (row,) = (row for row in asked_rows(outcomes) if "own file" in row["figure"])
    assert row["value"] == pytest.approx(1.25)
    assert row["reached"] == "must"


def test_lost_beams_are_compared_with_the_same_seeds_without() -> None:
    def drives(landmarks: float, step_ms: float) -> Outcome:
        return Outcome(
            None, [{"landmarks": landmarks, "step_ms": step_ms}, {"landmarks": 2 * landmarks, "step_ms": step_ms}]
        )

    rows = asked_rows({("park", dropped(0.0)): drives(20, 4.0), ("park", dropped(0.2)): drives(28, 9.0)})
    assert [(row["way"], row["value"], row["reached"]) for row in rows] == [
        ("20 % dropped", pytest.approx(1.4), "must"),
        ("20 % dropped", pytest.approx(2.25), "not reached"),
    ]
