"""A CAN bus on which a bad node, or one that means harm, says anything; past what python-can would check."""

import math
import struct
import threading
import time
from itertools import pairwise
from typing import Any

import can
import numpy as np
import pytest

from drivers.canbus.frame import CanFrame
from drivers.settings.can import BusSettings
from drivers.settings.encoders import EncoderSettings
from drivers.settings.layouts import Cia406Layout, PresetLayout
from drivers.wheels.encoders import CanEncoders
from drivers.wheels.layouts.choose import wheel_decoder
from drivers.wheels.pair import WheelPair
from tests.support.drivers.waiting import wait_until
from tests.support.mutations.wire_bytes import mutated

FRAMES = 100  # of an example
BUS = BusSettings(interface="virtual", channel="mutated frames")
LAYOUTS: dict[str, dict[str, Any]] = {
    "own": {},
    "odrive": {"layout": PresetLayout(kind="preset", name="odrive", left_node=1, right_node=2)},
    "cia402": {"layout": PresetLayout(kind="preset", name="cia402", left_node=1, right_node=2)},
    "cia406": {"layout": Cia406Layout(kind="cia406", left_node=1, right_node=2)},
}
ODD: dict[str, tuple[Any, ...]] = {
    "arbitration_id": (0, 0x7FF, 1 << 29, -1, 1.5, "left", None, 1 << 70),
    "data": (b"", bytes(64), bytes(65), None, "text", [1, 2]),
    "timestamp": (math.nan, math.inf, -1.0, 0.0, 1e300, 4e9, "now", None),
    "is_extended_id": (True, None, 2, "yes"),
    "is_error_frame": (True, None),
    "is_remote_frame": (True, None),
    "is_fd": (True, 7),
}


def layout(name: str) -> EncoderSettings:
    if name == "cia406":
        pytest.importorskip("canopen", reason="the extra canopen is not installed")
    return EncoderSettings(bus=BUS, **LAYOUTS[name])


def check_frames(name: str, seed: int) -> None:
    """FRAMES frames of a layout: whatever they hold, totals are numbers in the order of time."""
    rng = np.random.default_rng(seed)
    settings = layout(name)
    frames = wheel_decoder(settings)
    pair = WheelPair(settings, frames)
    ids, stamp_ns = list(frames.ids), 0
    for beat in range(FRAMES):
        stamp_ns += int(rng.choice([0, 1_000_000, 20_000_000, 10**12, -5_000_000], p=[0.1, 0.4, 0.45, 0.01, 0.04]))
        data = struct.pack("<iI", 50 * beat, 0) if rng.random() < 0.5 else mutated(bytes(8), rng)
        pair.feed(CanFrame(stamp_ns, int(rng.choice(ids)), data, int(rng.choice([0, 0, 0, 1, 2, 8]))))
    samples = pair.take()
    assert all(math.isfinite(sample.left) and math.isfinite(sample.right) for sample in samples)
    assert all(before.stamp_ns < after.stamp_ns for before, after in pairwise(samples))
    assert len(pair.events.drain()) <= 500


class Running:
    """A reader of the rover's own layout, and what its bus will say next in place of frames."""

    def __init__(self) -> None:
        self.sender = can.Bus(interface="virtual", channel=BUS.channel)
        self.encoders = CanEncoders(EncoderSettings(bus=BUS), time.monotonic_ns)
        self.encoders.start()
        self.heard = 0

    def send(self, rng: np.random.Generator) -> None:
        for _ in range(FRAMES):
            message = can.Message(
                arbitration_id=int(rng.choice([0x181, 0x182, 0x701, 0x702])), is_extended_id=False, check=False
            )
            message.data = bytearray(mutated(bytes(8), rng)[:64])
            for name in ODD:
                if rng.random() < 0.1:
                    setattr(message, name, ODD[name][int(rng.integers(0, len(ODD[name])))])
            self.put(message)

    def put(self, message: can.Message) -> None:
        """Past python-can's own send, which copies and checks."""
        for queue in self.sender.channel:  # type: ignore[attr-defined]
            if queue is not self.sender.queue:  # type: ignore[attr-defined]
                queue.put(message)
                self.heard += 1

    def close(self) -> None:
        self.encoders.close()
        self.sender.shutdown()


def check_thread(running: Running, seed: int) -> None:
    """FRAMES frames more: the thread reads on, and is the only one."""
    running.send(np.random.default_rng(seed))
    sender_queue = [queue for queue in running.sender.channel if queue is not running.sender.queue]  # type: ignore[attr-defined]
    wait_until(lambda: all(queue.empty() for queue in sender_queue))
    running.encoders.drain()
    running.encoders.drain_events()
    assert running.encoders._thread.is_alive()
    counters = running.encoders.health().counters
    assert counters.get("bus.defects", 0) == 0
    assert counters["bus.not_a_frame"] > 0
    assert [thread.name for thread in threading.enumerate()].count("encoders") == 1
