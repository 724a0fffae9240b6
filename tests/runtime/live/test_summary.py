"""What is said at the end of a run."""

from drivers.measurements import WheelCounts
from runtime.live import summary as summaries
from runtime.live.summary import ErrorTrack, silence
from runtime.live.timekeeping import Timekeeping
from runtime.tick import CompletedTick, Tick, Timing
from slam.estimator import Estimator
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
