import threading

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
    assert waiting.wait(10.0)
    thread.stop(10.0)
    assert ended.is_set()
    assert thread.was_stopped
    assert len(signs) == 2
    assert threading.get_ident() not in signs


def test_a_thread_that_was_never_started_can_be_stopped() -> None:
    thread = StoppableThread("never", lambda: None)
    thread.stop()
    assert thread.was_stopped
