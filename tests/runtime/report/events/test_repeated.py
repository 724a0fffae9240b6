from drivers.measurements import Event, Severity
from runtime.report.events.repeated import repeated
from runtime.report.events.states import state_times


def _event(time_s: float, source: str, kind: str, reason: str) -> Event:
    return Event(round(time_s * 1e9), source, kind, reason, Severity.WARN)


def test_a_report_that_repeats_with_other_figures_is_one_row_with_its_span() -> None:
    events = [_event(float(second), "laser", "late", f"scan late: {second} ms (3 more)") for second in range(10)]
    rows = repeated([*events, _event(30.0, "laser", "late", "scan late: 7 ms")], 0)
    spans = [(round(row.start_s, 3), round(row.end_s, 3), row.times) for row in rows]
    assert spans == [
        (0.0, 9.0, 10),
        (30.0, 30.0, 1),
    ]


def test_two_wheels_are_two_rows() -> None:
    rows = repeated([_event(1.0, "encoders", "crc", f"{side} wheel: wrong") for side in ("left", "right")], 0)
    assert len(rows) == 2


def test_health_that_flaps_is_one_span_with_its_share() -> None:
    events = [_event(0.0, "health", "running", "running")]
    for second in range(10, 50):
        events.append(_event(second, "health", "degraded", f"degraded: pose uncertain, by {second} m; laser stale: x"))
        events.append(_event(second + 0.5, "health", "running", "running"))
    running, degraded = state_times(events, 0, 100.0)
    assert (running.state, degraded.state) == ("running", "degraded")
    assert degraded.seconds == 20.0
    assert degraded.share == 0.2
    assert degraded.spans == ((10.0, 49.5),)
    assert dict(degraded.reasons) == {"pose uncertain": 20.0, "laser stale": 20.0}


def test_what_to_do_about_a_reason_is_no_reason_of_its_own() -> None:
    text = "lost: pose lost, nothing on the map is seen: for 3.1 s; laser stale: no scan; tcp://10.0.0.1 is open; look"
    (lost,) = state_times([_event(0.0, "health", "lost", text)], 0, 2.0)
    assert dict(lost.reasons) == {"pose lost, nothing on the map is seen": 2.0, "laser stale": 2.0}


def test_what_was_before_the_first_tick_and_after_the_last_does_not_count() -> None:
    events = [_event(-2.0, "health", "degraded", "degraded: laser stale"), _event(5.0, "health", "lost", "lost: pose")]
    lost, degraded = state_times(events, 0, 20.0)
    assert (lost.seconds, degraded.seconds) == (15.0, 5.0)
    assert state_times([], 0, 20.0) == []
