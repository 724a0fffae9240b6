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


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_the_state_has_its_colour_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(status_line, "TERMINAL_PERIOD_S", 0.01)
    monkeypatch.setattr(status_line, "LOG_PERIOD_S", 0.01)
    for stream, colours, shown in ((Terminal(), True, "\x1b[32mrunning\x1b[0m"), (io.StringIO(), True, "  running\n")):
        line = StatusLine(stream, colours)
        (completed,) = completed_ticks(1)
        line.note(completed, HealthMonitor().assess(0, {}, {}, completed.estimate)[0])
        line.start()
        assert until(lambda stream=stream: bool(stream.getvalue()), 60.0)  # type: ignore[misc]
        line.close()
        assert shown in stream.getvalue()
