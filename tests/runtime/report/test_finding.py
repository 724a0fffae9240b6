import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from drivers.measurements import Severity
from runtime.report.finding import Finding, intervals_where, silences, span_text, worst

TIMES = st.lists(st.floats(0.0, 100.0), max_size=50).map(lambda values: np.array(sorted(values), dtype=np.float64))


@given(TIMES, st.floats(0.1, 10.0))
def test_no_sample_lies_inside_a_silence(times_s: np.ndarray, least_s: float) -> None:
    for start, end in silences(times_s, 100.0, least_s):
        assert end - start >= least_s
        assert not ((times_s > start) & (times_s < end)).any()


def test_a_sensor_that_never_spoke_was_silent_all_the_time() -> None:
    assert silences(np.empty(0), 20.0, 0.5) == ((0.0, 20.0),)


@given(TIMES, st.floats(0.0, 5.0))
def test_intervals_hold_every_moment_and_lie_apart(times_s: np.ndarray, joined_s: float) -> None:
    intervals = intervals_where(times_s, np.ones(times_s.size, dtype=np.bool_), joined_s)
    assert all(any(start <= time <= end for start, end in intervals) for time in times_s)
    assert all(after[0] - before[1] > joined_s for before, after in itertools.pairwise(intervals))


def test_times_read_as_the_seconds_of_the_plots() -> None:
    assert span_text((12.06, 13.4)) == "12.1-13.4 s"
    assert span_text((190.0, 260.0)) == "190-260 s"
    assert span_text((57.31, 57.34)) == "57.3 s"
    assert span_text((193.24, 193.96)) == "193.2-194.0 s"


def test_the_gravest_finding_decides() -> None:
    findings = [Finding("a", severity, "", (), "", "") for severity in (Severity.INFO, Severity.ERROR, Severity.WARN)]
    assert worst(findings) is Severity.ERROR
    assert worst([]) is Severity.INFO
