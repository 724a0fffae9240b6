"""The page is told of the rover five times a second, whatever comes in between."""

from types import SimpleNamespace

import pytest

from runtime.page import hub
from runtime.publish.find_rover import FoundRover

DRIVEN_S = 10.0
PAUSE_NS = 70_000_000  # between two messages: no part of a fifth of a second


def test_five_beats_a_second_come_out_of_messages_that_keep_another_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now = SimpleNamespace(ns=0)

    def next_message(_wait_s: float) -> None:
        now.ns += PAUSE_NS

    monkeypatch.setattr(hub, "time", SimpleNamespace(monotonic_ns=lambda: now.ns, monotonic=lambda: now.ns * 1e-9))
    page = hub.Hub(FoundRover("r1", "tcp/127.0.0.1:1"))
    monkeypatch.setattr(page, "_thread", SimpleNamespace(is_stopping=lambda: now.ns > DRIVEN_S * 1e9))
    follower = SimpleNamespace(has_come=lambda: False, next=next_message, is_there=True)
    page._follow(follower)  # type: ignore[arg-type]
    assert page._number == pytest.approx(DRIVEN_S * hub.BEATS_HZ, abs=1)
