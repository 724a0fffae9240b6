"""The line of a live run, as a log shows it."""

import io

import pytest

from runtime.health import HealthMonitor
from runtime.live import status_line
from runtime.live.status_line import StatusLine
from tests.support.runtime.drawn_drive import completed_ticks
from tests.support.zenoh.wire import until


def test_the_first_line_has_the_rate_since_the_first_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(status_line, "LOG_PERIOD_S", 0.01)
    stream = io.StringIO()
    line = StatusLine(stream)
    for completed in completed_ticks(20):
        tick = completed.tick
        line.note(completed, HealthMonitor().assess(tick.stamp_ns, {}, {}, completed.estimate)[0])
    line.start()
    assert until(lambda: bool(stream.getvalue()), 60.0)
    line.close()
    assert "10.00 Hz" in stream.getvalue().splitlines()[0]
