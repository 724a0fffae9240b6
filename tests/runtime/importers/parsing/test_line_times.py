"""Times of a log's lines where the stamps have lost their digits: nothing is lost, and what is guessed is said."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from runtime.importers.parsing.line_times import line_times
from tests.support.runtime.carmen_logs import imported, room_log


def rewritten(lines: list[str], stamps: Callable[[float], str]) -> list[str]:
    """The same lines with the stamp of when they were logged printed otherwise."""
    return [f"{line.rsplit(' ', 1)[0]} {stamps(float(line.rsplit(' ', 1)[1]))}" for line in lines]


def test_the_other_stamp_of_a_line_is_used_where_one_lacks_digits(tmp_path: Path) -> None:
    result = imported(tmp_path, rewritten(room_log(60), lambda stamp_s: f"{stamp_s:g}"))
    assert (result["scans"], result["wheel_samples"], result["warnings"]) == (60, 60, [])
    assert result["duration_s"] == pytest.approx(5.9, abs=0.01)


@pytest.mark.parametrize(
    ("printed", "duration_s", "said"),
    [
        ("{:g}", 59 * 0.2, "0.2 s apart: speeds are not real"),
        ("{:.0f}", 6.5, "spread evenly up to the next stamp"),
        ("0", 59 * 0.2, "0.2 s apart: speeds are not real"),
    ],
)
def test_stamps_that_lack_digits_lose_no_scan_and_are_said(
    tmp_path: Path, printed: str, duration_s: float, said: str
) -> None:
    words = [line.split(" ") for line in room_log(60)]
    lines = [
        " ".join([*each[:-3], printed.format(float(each[-3])), "host", printed.format(float(each[-1]))])
        for each in words
    ]
    result = imported(tmp_path, lines)
    assert (result["scans"], result["wheel_samples"]) == (60, 120)
    assert result["duration_s"] == pytest.approx(duration_s, rel=0.1)
    (warning,) = result["warnings"]
    assert said in warning


def test_lines_before_a_pause_keep_the_usual_distance() -> None:
    given = np.repeat([0.0, 1.0, 2.0, 50.0, 51.0, 52.0], 4)
    is_scan = np.ones(24, bool)
    times = line_times([given], is_scan, ~is_scan)
    np.testing.assert_allclose(times.stamps_s, given + np.tile([0.0, 0.25, 0.5, 0.75], 6))
    assert times.good.all()


def test_good_stamps_stay_as_they_are() -> None:
    given = np.repeat(np.arange(100) * 0.1, 2)  # a scan and the odometry at the same time
    is_scan = np.arange(200) % 2 == 0
    times = line_times([given, given + 5.0], is_scan, ~is_scan)
    np.testing.assert_array_equal(times.stamps_s, given)
    assert times.lost == ""
