import logging
import threading
import time

import pytest

from drivers.stoppable_thread import StoppableThread


def test_a_thread_that_waits_returns_when_it_is_stopped_and_has_shown_signs_of_life() -> None:
    signs: list[int] = []
    waiting = threading.Event()
    ended = threading.Event()

    def run() -> None:
        while not thread.is_stopping():
            waiting.set()
            thread.wait(60.0)
        ended.set()

    thread = StoppableThread("waits", run, lambda: signs.append(threading.get_ident()))
    thread.start()
    assert waiting.wait(120.0)
    thread.stop(120.0)
    assert ended.is_set()
    assert thread.was_stopped
    assert len(signs) == 2
    assert threading.get_ident() not in signs


def test_a_thread_that_was_never_started_can_be_stopped() -> None:
    thread = StoppableThread("never", lambda: None)
    thread.stop()
    assert thread.was_stopped


def test_a_thread_that_fails_and_cannot_tell_it_waits_before_it_begins_again() -> None:
    runs: list[float] = []
    enough = threading.Event()

    def run() -> None:
        runs.append(time.monotonic())
        if len(runs) == 3:
            enough.set()
        raise ValueError("fails")

    def failed(what: str) -> None:
        raise OSError(what)

    thread = StoppableThread("fails", run, failed=failed)
    thread.start()
    assert enough.wait(120.0)
    thread.stop(120.0)
    assert runs[2] - runs[0] > 0.25
    assert not thread.is_alive()


def test_a_failure_that_nobody_is_told_of_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    failed = threading.Event()

    def run() -> None:
        if failed.is_set():
            return
        failed.set()
        raise ValueError("fails")

    thread = StoppableThread("fails", run)
    with caplog.at_level(logging.ERROR):
        thread.start()
        assert failed.wait(120.0)
        thread.stop(120.0)
    assert "the thread fails failed and is restarted: ValueError('fails')" in caplog.text
