"""Privileges are taken where they are given, and given back in a way that the kernel allows to everyone."""

import os
from typing import Any

import pytest

from runtime.service.realtime import enter_real_time, leave_real_time


class OrdinaryUser:
    """The kernel's rules of sched_setscheduler(2) for a process with RLIMIT_RTPRIO and without CAP_SYS_NICE."""

    def __init__(self) -> None:
        self.policy = os.SCHED_OTHER

    def get(self, _pid: int) -> int:
        return self.policy

    def set(self, _pid: int, policy: int, _param: Any) -> None:
        if self.policy & os.SCHED_RESET_ON_FORK and not policy & os.SCHED_RESET_ON_FORK:
            raise PermissionError(1, "Operation not permitted")
        self.policy = policy


def test_a_user_without_privileges_returns_from_real_time(monkeypatch: pytest.MonkeyPatch) -> None:
    user = OrdinaryUser()
    monkeypatch.setattr(os, "sched_setscheduler", user.set)
    monkeypatch.setattr(os, "sched_getscheduler", user.get)
    enter_real_time(50)
    assert user.policy & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
    leave_real_time()
    assert user.policy & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER


def test_memory_is_locked_before_the_priority_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []

    class Library:
        def mlockall(self, _flags: int) -> int:
            order.append("memory")
            return 0

        def munlockall(self) -> int:
            return 0

    monkeypatch.setattr("runtime.service.realtime.ctypes.CDLL", lambda *_names, **_options: Library())
    monkeypatch.setattr(os, "sched_setscheduler", lambda *_arguments: order.append("priority"))
    assert enter_real_time(50) == ()
    leave_real_time()
    assert order[:2] == ["memory", "priority"]


def test_a_refusal_is_one_sentence_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_arguments: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    refusals = enter_real_time(50)
    leave_real_time()
    assert any("no real-time priority" in each and "LimitRTPRIO=60" in each for each in refusals)
