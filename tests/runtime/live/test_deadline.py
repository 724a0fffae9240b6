"""A deadline bounds the whole run: by an injected clock, and by what an alarm interrupts."""

import io
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any, cast

import pytest

from drivers.measurements import Event
from runtime.live import run
from runtime.live.deadline import Deadline, TimeIsOver, process_began_ns
from runtime.live.parts import Parts
from runtime.record.folder import RunFolder
from runtime.service.systemd import ServiceManager
from runtime.settings.configuration import load_configuration
from runtime.source_tree import ROOT
from runtime.tick import SinkHealth
from tests.runtime.live.test_loop import ObedientClock, StillSensors, ThinkingEstimator

SECOND_NS = 1_000_000_000


class Nobody:
    """A recorder, publisher and watch of threads that do nothing."""

    def put_events(self, _stamp_ns: int, _events: tuple[Event, ...]) -> None: ...
    def announce(self, _health: object) -> None: ...
    def note_health(self, _health: object) -> None: ...
    def begin(self) -> None: ...

    def drain_events(self) -> tuple[Event, ...]:
        return ()

    def stuck(self) -> str:
        return ""


class Drawing:
    """Knows until when it may draw."""

    def __init__(self) -> None:
        self.latest_s: list[float] = []

    def finish_by(self, latest_s: float) -> None:
        self.latest_s.append(latest_s)

    def health(self) -> SinkHealth:
        return SinkHealth(0, 0, "")


def drive(
    monkeypatch: pytest.MonkeyPatch, folder: Path, loading_s: float, duration_s: float
) -> tuple[int, float, list[float]]:
    """Ticks of a run whose kernels take so long to load, when it ended, and until when the picture may be drawn."""
    clock, drawing, nobody = ObedientClock(), Drawing(), cast(Any, Nobody())
    parts = Parts(StillSensors(), StillSensors(), {}, nobody, nobody, None, nobody, cast(Any, drawing))

    def load(*_words: object) -> float:
        clock.time_ns += round(loading_s * 1e9)
        return 0.0

    monkeypatch.setattr(run, "load_kernels", load)
    monkeypatch.setattr(run, "Estimator", lambda *_words, **_named: ThinkingEstimator(clock, lambda _step: 0))
    host = run.Host(clock, threading.Event(), io.StringIO(), ServiceManager(""), deadline=Deadline.after(duration_s, 0))
    configuration = load_configuration(ROOT / "config" / "mock.toml", {})
    summary = run.run_live(configuration, RunFolder.create(folder, folder), host, None, lambda *_words: parts)
    return summary["ticks"], clock.now_ns() * 1e-9, drawing.latest_s


def test_what_loading_took_is_not_driven_and_two_seconds_are_for_closing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ticks, ended_s, latest_s = drive(monkeypatch, tmp_path / "run", loading_s=7.0, duration_s=20.0)
    assert ticks == round((20.0 - 2.0 - 7.0 - run.LEAD_NS * 1e-9) * 10)
    assert ended_s <= 18.0 < latest_s[0] < 20.0


def test_a_run_whose_loading_takes_all_the_time_does_not_drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(TimeIsOver):
        drive(monkeypatch, tmp_path / "run", loading_s=25.0, duration_s=20.0)


def test_half_of_a_short_time_is_for_driving_and_the_picture_is_given_up_before_all_ends() -> None:
    short = Deadline.after(1.0, 5 * SECOND_NS)
    assert (short.drive_until_ns, short.ends_ns) == (5.5 * SECOND_NS, 6 * SECOND_NS)
    for each in (short, Deadline.after(30.0, 0)):
        assert each.drive_until_ns < each.closed_by_ns < each.ends_ns


def test_whatever_the_start_waits_for_is_interrupted() -> None:
    """As the answer of a simulated rover that does not come: without the alarm this would wait for ever."""
    reads, writes = os.pipe()
    before, now_ns = signal.getsignal(signal.SIGALRM), time.monotonic_ns()
    with pytest.raises(TimeIsOver), Deadline(now_ns + 1_000_000).interrupts(now_ns):
        os.read(reads, 1)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGALRM) is before
    os.close(reads)
    os.close(writes)


def test_a_run_without_a_deadline_sets_no_alarm() -> None:
    before = signal.getsignal(signal.SIGALRM)
    with Deadline().interrupts(0):
        assert signal.getsignal(signal.SIGALRM) is before


def test_the_time_counts_from_the_start_of_the_process() -> None:
    """The interpreter has begun and loaded before anything of ours runs."""
    began_ns, after_ns = process_began_ns(), time.monotonic_ns()
    code = "from runtime.live.deadline import process_began_ns; print(process_began_ns())"
    child_ns = int(subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, check=True).stdout)
    assert began_ns < after_ns - 10_000_000 < child_ns < time.monotonic_ns()
    assert abs(process_began_ns() - began_ns) < 10_000_000
