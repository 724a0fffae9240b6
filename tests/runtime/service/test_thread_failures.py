"""Whatever is raised in a thread of the runtime, it goes on, counted and named."""

import ctypes
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
import zenoh

from runtime.publish.session import tool_config
from runtime.record.reader import RunReader
from runtime.service import thread_watch
from runtime.service.thread_watch import Failures
from tests.runtime.record.writing.test_recorder import put, start, wait_until
from tests.support.zenoh.wire import free_port, opened, publishing, put_ticks, settings_on, until

TIMES = 2


@pytest.fixture(autouse=True)
def trouble_is_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    """However long a busy machine takes to look at it."""
    monkeypatch.setattr(thread_watch, "TOLD_NS", 600_000_000_000)


class Thrown(Exception):  # noqa: N818 it stands for any error
    """Raised in a thread from outside, at whatever line it is."""


def throw_into(name: str) -> None:
    (thread,) = [each for each in threading.enumerate() if each.name == name]
    assert thread.ident is not None
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread.ident), ctypes.py_object(Thrown))


def test_a_failure_is_counted_named_and_forgotten() -> None:
    now_ns = 0
    failures = Failures("recorder", lambda: now_ns)
    assert failures.trouble == ""
    failures.note("ZeroDivisionError() in line 7")
    failures.note("ZeroDivisionError() in line 8")
    assert failures.trouble == (
        "the thread recorder failed and was restarted (2 so far): ZeroDivisionError() in line 8"
    )
    now_ns = thread_watch.TOLD_NS + 1
    assert failures.trouble == ""


def holds(throw: Callable[[], None], works: Callable[[], bool], trouble: Callable[[], str]) -> None:
    """The thread is hit several times, works again each time, and says what it was."""
    for count in range(1, TIMES + 1):
        throw()
        assert until(lambda: works() and f"({count} so far): Thrown()" in trouble()), trouble()  # noqa: B023


def test_the_recorder_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hit before it asks the disk: between two lines of the library the file itself would be spoilt."""
    recorder = start(tmp_path / "run")
    seqs = iter(range(100_000))
    hit, visit_disk = threading.Event(), recorder._storage.visit_disk

    def visit(now_ns: int) -> None:
        if hit.is_set():
            hit.clear()
            raise Thrown
        visit_disk(now_ns)

    monkeypatch.setattr(recorder._storage, "visit_disk", visit)

    def works() -> bool:
        seq = next(seqs)
        put(recorder, range(seq, seq + 1))
        return until(lambda: recorder.health().depth == 0)

    holds(hit.set, works, lambda: recorder.health().trouble)
    put(recorder, range(100_000, 100_003))
    recorder.close()
    wait_until(lambda: not any(each.name == "recorder" for each in threading.enumerate()))
    reader = RunReader(tmp_path / "run")
    assert [each.tick.seq for each in reader.ticks()][-3:] == [100_000, 100_001, 100_002]
    assert reader.truncated == ""


def test_the_publisher_goes_on() -> None:
    port = free_port()
    with publishing(settings_on(port)) as publisher:
        assert opened(publisher)

        def works() -> bool:
            put_ticks(publisher, range(12), 0.0)
            if not until(lambda: publisher.health().depth == 0):  # the session answers without its thread
                return False
            try:
                with zenoh.open(tool_config(f"tcp/127.0.0.1:{port}")) as session:
                    return any(reply.ok for reply in session.get("infant/r1/status", timeout=0.3))
            except zenoh.ZError:
                return False

        assert until(works)
        holds(lambda: throw_into("publish"), works, lambda: publisher.health().trouble)
