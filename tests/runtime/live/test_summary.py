"""What is said at the end of a run."""

from dataclasses import replace

import pytest

from drivers.measurements import WheelCounts
from runtime.live import summary as summaries
from runtime.live.summary import ErrorTrack, silence
from runtime.live.timekeeping import Timekeeping
from runtime.tick import CompletedTick, Tick, Timing
from slam.estimator import Estimator
from slam.pose import Pose2
from slam.settings.slam import SlamSettings


def summary_of(*wheels: WheelCounts) -> dict[str, object]:
    errors = ErrorTrack()
    estimate = Estimator(SlamSettings(), 1).step(1_000, None, ())
    errors.put(CompletedTick(Tick(0, 1_000, None, wheels), estimate, Timing(0, 0, {}), b"", None))
    return summaries.summarise("runs/a", Timekeeping(), errors, {})


def test_a_run_in_which_no_sensor_spoke_says_so_and_names_the_check() -> None:
    invalid = WheelCounts(900, 0.0, 0.0, valid=False)
    assert "infant check --config rover.toml --live" in silence(summary_of(invalid), "rover.toml")
    assert silence(summary_of(WheelCounts(900, 0.0, 0.0)), "rover.toml") == ""


def test_the_summary_ends_with_the_next_command() -> None:
    assert summaries.summary_lines(summary_of())[-1] == "next      infant review runs/a"


@pytest.mark.parametrize(
    ("maps_known", "recognised", "count", "rms_m"),
    [
        (2.0, (None, None, 0.0, 0.0), 2, 0.5),  # found its place in the saved map with the third tick
        (2.0, (None, None, None, None), 4, 3.5),  # never did
        (1.0, (None, None, 0.0, 0.0), 4, 3.5),  # began in its own map and closed a loop
    ],
)
def test_poses_before_the_place_in_a_saved_map_was_known_do_not_count_as_in_an_evaluation(
    maps_known: float, recognised: tuple[float | None, ...], count: int, rms_m: float
) -> None:
    errors, estimate = ErrorTrack(), Estimator(SlamSettings(), 1).step(1_000, None, ())
    for seq, (is_new, error_m) in enumerate(zip(recognised, (4.0, 5.6, 0.5, 0.5), strict=True)):
        counts = {"maps_known": maps_known} | ({} if is_new is None else {"recognised_is_new": is_new})
        told = replace(estimate, counts=counts, map_from_body=Pose2(error_m, 0.0, 0.0))
        truth = Pose2(0.0, 0.0, 0.0)
        errors.put(CompletedTick(Tick(seq, 1_000, None, ()), told, Timing(0, 0, {}), b"", truth))
    assert (errors.slam.count, errors.odometry.count) == (count, count)
    assert errors.slam.rms_m == pytest.approx(rms_m, abs=0.05)
