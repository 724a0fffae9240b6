"""Free ports, a rover that publishes on one of them, and listeners in other processes."""

import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from runtime.publish.publisher import ZenohPublisher
from runtime.settings.publish import PublishSettings
from runtime.source_tree import ROOT
from runtime.tick import CompletedTick
from tests.support.runtime.recorded_values import make_estimate, make_tick, make_timing

WALL_OFFSET_NS = 1_700_000_000_000_000_000


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def until(condition: Callable[[], bool], seconds: float = 600.0) -> bool:
    deadline_s = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline_s:
            return False
        time.sleep(0.005)
    return True


def settings_on(port: int, **changes: Any) -> PublishSettings:
    return PublishSettings(**{"listen": (f"tcp/127.0.0.1:{port}",), "connect": (), **changes})


@contextmanager
def publishing(settings: PublishSettings, rover: str = "r1", **options: Any) -> Iterator[ZenohPublisher]:
    publisher = ZenohPublisher(settings, rover, WALL_OFFSET_NS, **options)
    try:
        yield publisher
    finally:
        publisher.close()


def opened(publisher: ZenohPublisher, within_s: float = 600.0) -> tuple[str, ...]:
    """Wait until the session is open and return where it listens; empty if it is not open by then."""
    until(lambda: publisher.listening is not None, within_s)
    return publisher.listening or ()


def put_ticks(publisher: ZenohPublisher, seqs: range, period_s: float) -> list[float]:
    """Put ticks on a grid; returns how long each put took, in seconds."""
    rng, costs_s, start_s = np.random.default_rng(1), [], time.monotonic()
    for beat, seq in enumerate(seqs):
        tick, estimate, timing = make_tick(seq, rng), make_estimate(seq * 100_000_000, rng), make_timing(seq)
        time.sleep(max(0.0, start_s + beat * period_s - time.monotonic()))
        began_s = time.perf_counter()
        publisher.put(CompletedTick(tick, estimate, timing, bytes(16), None))
        costs_s.append(time.perf_counter() - began_s)
    return costs_s


class Listener:
    """A process that subscribes; `messages` fills while it runs."""

    def __init__(self, endpoint: str, key: str, seconds: float = 1200.0) -> None:
        self.messages: list[dict[str, Any]] = []
        self.ready = threading.Event()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.support.zenoh.listener", endpoint, key, str(seconds)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if line == "ready\n":
                self.ready.set()
            else:
                self.messages.append(json.loads(line))

    def payloads(self, key: str) -> list[bytes]:
        return [bytes.fromhex(message["payload"]) for message in list(self.messages) if message["key"] == key]

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self._thread.join(2.0)
        if self.process.stdout is not None:
            self.process.stdout.close()


@contextmanager
def listening(endpoint: str, key: str, seconds: float = 1200.0) -> Iterator[Listener]:
    listener = Listener(endpoint, key, seconds)
    try:
        assert listener.ready.wait(600.0), "the listener did not come up"
        yield listener
    finally:
        listener.close()


def start_module(module: str, *arguments: str) -> "subprocess.Popen[bytes]":
    """A module of the tests in a process of its own, once it has said that it is ready."""
    process = subprocess.Popen([sys.executable, "-m", module, *arguments], cwd=ROOT, stdout=subprocess.PIPE)
    assert process.stdout is not None
    with process.stdout as said:
        assert said.readline() == b"ready\n"
    return process
