"""The service manager's watchdog is fed by completed ticks only, and only while no thread of ours hangs."""

import io
import socket
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.laser.hokuyo import Hokuyo
from drivers.measurements import Severity
from drivers.settings.can import BusSettings
from drivers.settings.encoders import EncoderSettings
from drivers.settings.laser import LaserSettings
from drivers.wheels.encoders import CanEncoders
from runtime.messages.tick import Record
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RecordFile
from runtime.record.writing.recorder import Recorder
from runtime.service.systemd import ServiceManager, WatchdogFeed
from runtime.service.thread_watch import TIMEOUT_S, ThreadWatch
from runtime.source_tree import ROOT
from tests.support.zenoh.wire import until

S = 1_000_000_000


class SetClock:
    """Time as the test says it is."""

    def __init__(self) -> None:
        self.ns = 5 * S

    def now_ns(self) -> int:
        return self.ns


class Sign:
    """Counts the heartbeats of a thread."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self) -> None:
        self.count += 1

    def goes_on(self) -> bool:
        before = self.count
        return until(lambda: self.count > before + 3)


def test_a_thread_that_goes_silent_is_named_with_its_seconds() -> None:
    clock = SetClock()
    watch = ThreadWatch(clock.now_ns)
    laser, _ = watch.heartbeat("laser"), watch.heartbeat("recorder")
    watch.begin()
    clock.ns += round(TIMEOUT_S * S)
    assert watch.stuck() == ""
    laser()
    clock.ns += S
    assert watch.stuck() == "the thread recorder has not responded for 31 s"


def test_a_hang_and_its_end_are_one_event_each() -> None:
    clock = SetClock()
    watch = ThreadWatch(clock.now_ns)
    laser = watch.heartbeat("laser")
    watch.begin()
    assert watch.drain_events() == ()
    clock.ns += round(TIMEOUT_S * S) + S
    (hangs,) = watch.drain_events()
    assert (hangs.source, hangs.kind, hangs.severity) == ("laser", "hangs", Severity.ERROR)
    assert hangs.reason == "the thread laser has not responded for 31 s; the watchdog is not fed meanwhile"
    assert watch.drain_events() == ()
    laser()
    (again,) = watch.drain_events()
    assert (again.reason, again.severity) == ("the thread laser works again", Severity.INFO)


def test_the_longest_wait_of_a_thread_is_no_silence() -> None:
    clock = SetClock()
    watch = ThreadWatch(clock.now_ns)
    watch.heartbeat("laser", longest_wait_s=60.0)
    watch.begin()
    clock.ns += 80 * S
    assert watch.stuck() == ""
    clock.ns += 20 * S
    assert "laser" in watch.stuck()


def test_nothing_is_counted_before_the_threads_are_started() -> None:
    clock = SetClock()
    watch = ThreadWatch(clock.now_ns)
    watch.heartbeat("laser")
    clock.ns += 3600 * S
    assert watch.stuck() == ""


def test_an_allowed_silence_is_not_counted_and_no_longer() -> None:
    clock, at_disk = SetClock(), True
    watch = ThreadWatch(clock.now_ns)
    watch.heartbeat("recorder")
    watch.allow_silence("recorder", lambda: at_disk)
    watch.begin()
    clock.ns += 3600 * S
    assert watch.stuck() == ""
    at_disk = False
    assert "recorder" in watch.stuck()


def test_a_tick_feeds_the_watchdog_unless_a_thread_hangs_which_is_said_once(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager_end:
        manager_end.bind(str(tmp_path / "notify"))
        manager_end.settimeout(120.0)
        manager, said = ServiceManager(str(tmp_path / "notify")), io.StringIO()
        feed = WatchdogFeed(manager, said)
        feed.completed_tick("")
        assert manager_end.recv(100) == b"WATCHDOG=1"
        for _ in range(3):
            feed.completed_tick("the thread laser has not responded for 31 s")
        manager.status("last")
        assert manager_end.recv(100) == b"STATUS=last"  # and no WATCHDOG=1 before it
        assert said.getvalue().count("the thread laser") == 1
        manager.close()


def test_a_shutdown_may_take_longer_than_the_watchdog_waits(tmp_path: Path) -> None:
    unit = (ROOT / "systemd" / "infant.service").read_text()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager_end:
        manager_end.bind(str(tmp_path / "notify"))
        manager_end.settimeout(120.0)
        manager = ServiceManager(str(tmp_path / "notify"))
        manager.stopping()
        told = dict(line.split("=") for line in manager_end.recv(200).decode().splitlines())
        assert told["STOPPING"] == "1"
        assert f"TimeoutStopSec={int(told['WATCHDOG_USEC']) // 1_000_000}s" in unit.splitlines()
        manager.close()


def test_the_lasers_thread_gives_signs_while_nobody_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.laser.hokuyo.RETRY_MAX_S", 0.1)
    sign = Sign()
    laser = Hokuyo(LaserSettings(url="tcp://127.0.0.1:9"), lambda: 0, alive=sign)
    laser.start()
    assert sign.goes_on()
    laser.close()


def test_the_wheels_thread_gives_signs_on_a_silent_bus() -> None:
    sign = Sign()
    bus = BusSettings(interface="virtual", channel="silent")
    wheels = CanEncoders(EncoderSettings(bus=bus), lambda: 0, alive=sign)
    wheels.start()
    assert sign.goes_on()
    wheels.close()


@pytest.fixture
def stalled(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], threading.Event]:
    """A method of the record's file that does not come back until the event is set."""

    def stall(method: str) -> threading.Event:
        go_on = threading.Event()
        real = getattr(RecordFile, method)

        def wait(file: RecordFile) -> None:
            go_on.wait(240.0)
            real(file)

        monkeypatch.setattr(RecordFile, method, wait)
        return go_on

    return stall


def test_a_disk_that_does_not_answer_is_a_state_and_no_reason_to_restart(
    tmp_path: Path, stalled: Callable[[str], threading.Event]
) -> None:
    clock = SetClock()
    watch = ThreadWatch(clock.now_ns)
    header = RunHeader.of_live_run("", {})
    recorder = Recorder(RunFolder.create(tmp_path / "run", tmp_path), header, threads=watch)
    watch.begin()
    go_on = stalled("sync")
    clock.ns += 2 * S
    assert until(lambda: recorder.may_be_silent)
    clock.ns += 40 * S
    assert "the disk has not answered for 4" in recorder.health().trouble
    assert watch.stuck() == ""
    go_on.set()
    assert until(lambda: recorder.health().trouble == "")
    recorder.close()


def test_a_recorder_that_hangs_in_our_own_code_is_not_excused(tmp_path: Path) -> None:
    clock = SetClock()
    watch = ThreadWatch(clock.now_ns)
    go_on, hangs = threading.Event(), threading.Event()

    class Hanging:
        def feed(self, record: Record) -> None:
            hangs.set()
            go_on.wait(240.0)

        def segment_closed(self, number: int, stamp_ns: int) -> None: ...

    folder = RunFolder.create(tmp_path / "run", tmp_path)
    recorder = Recorder(folder, RunHeader.of_live_run("", {}), observers=[Hanging()], threads=watch)
    watch.begin()
    recorder.can_frame(clock.ns, 0x181, 0, b"12345678")
    assert hangs.wait(240.0)
    clock.ns += 40 * S
    assert "recorder" in watch.stuck()
    go_on.set()
    assert until(lambda: watch.stuck() == "")
    recorder.close()
