"""What runs inside the guest: the production reader against vcan and kernel slcan, the node in another process."""

import os
import pty
import subprocess
import sys
import time
import tty
from collections.abc import Callable
from pathlib import Path

import numpy as np

from drivers.measurements import SensorState, WheelCounts
from drivers.settings.can import BusSettings
from drivers.settings.encoders import EncoderSettings
from drivers.settings.simulated_wheels import SimulatedWheelSettings
from drivers.simulated.wheels.encoder_nodes import EncoderNodes
from drivers.wheels.encoders import CanEncoders
from drivers.wheels.readings import Wheel
from tests.system.bench.guest import burst, inject_error, load_modules, report, shell

LEFT_MPS, RIGHT_MPS = 0.1, 0.12  # slow, because a guest without real time stamps late by tens of ms
VCAN = BusSettings(interface="socketcan", channel="vcan0")
COUNTS_PER_METRE = EncoderSettings().counts_per_metre
NODE = f"""
import sys, time, numpy as np
from drivers.simulated.wheels.node import WheelNode
from drivers.settings.simulated_wheels import SimulatedWheelSettings
from drivers.settings.can import BusSettings
from drivers.settings.encoders import EncoderSettings
encoders = EncoderSettings(bus=BusSettings(interface="socketcan", channel="vcan0"))
node = WheelNode(SimulatedWheelSettings(slip_std_per_m=0.0), encoders,
                 lambda t: (t * 1e-9 * {LEFT_MPS}, t * 1e-9 * {RIGHT_MPS}), time.monotonic_ns, np.random.default_rng(1))
node.start()
sys.stdin.read()
node.close()
"""


class Watch:
    """The reader with what it said, compared with the course that the node drives."""

    def __init__(self, bus: BusSettings) -> None:
        self.encoders = CanEncoders(EncoderSettings(bus=bus), time.monotonic_ns)
        self.samples: list[WheelCounts] = []
        self.kinds: set[str] = set()
        self.encoders.start()

    def drain(self) -> None:
        self.samples += self.encoders.drain()
        self.kinds |= {event.kind for event in self.encoders.drain_events()}

    def until(self, condition: Callable[[], bool], limit_s: float = 10.0) -> float:
        """Seconds until it was so; -1 after the limit."""
        start = time.monotonic()
        while time.monotonic() - start < limit_s:
            self.drain()
            if condition():
                return time.monotonic() - start
            time.sleep(0.02)
        return -1.0

    def fresh(self) -> bool:
        return (
            self.encoders.health().state is SensorState.FRESH
            and bool(self.samples)
            and self.samples[-1].valid
            and time.monotonic_ns() - self.samples[-1].stamp_ns < 200_000_000
        )

    def failed(self) -> bool:
        return self.encoders.health().state is SensorState.FAILED

    def wrong_motion_mm(self) -> float:
        """Largest step in the deviation of any wheel from the course, between samples that claim to know."""
        worst = 0.0
        valid = [sample for sample in self.samples if sample.valid]
        for name, speed in (("left", LEFT_MPS), ("right", RIGHT_MPS)):
            errors = [getattr(s, name) / COUNTS_PER_METRE - s.stamp_ns * 1e-9 * speed for s in valid]
            worst = max(worst, max(errors) - min(errors))
        return worst * 1000.0

    def counters(self) -> dict[str, int]:
        return self.encoders.health().counters


def scenario(name: str, watch: Watch, begin: Callable[[], None], end: Callable[[], None], hold_s: float) -> None:
    """Begin trouble, hold it, end it, and tell how long the way back was."""
    began = time.monotonic()
    begin()
    watch.until(lambda: time.monotonic() - began > hold_s)
    state, reason = watch.encoders.health().state, watch.encoders.health().reason
    end()
    recovery_s = watch.until(watch.fresh)
    report(
        name,
        during=str(state),
        reason=reason,
        recovery_s=recovery_s,
        wrong_mm=watch.wrong_motion_mm(),
        counters=watch.counters(),
    )


def on_vcan() -> None:
    absent = Watch(VCAN)
    absent.until(lambda: absent.counters().get("bus.open", 0) >= 2)
    report("absent", reason=absent.encoders.health().reason, attempts=absent.counters()["bus.open"])
    shell("ip link add vcan0 type vcan")
    absent.until(lambda: "down" in absent.encoders.health().reason)
    report("down", reason=absent.encoders.health().reason)
    absent.encoders.close()
    shell("ip link set vcan0 up")
    with subprocess.Popen([sys.executable, "-c", NODE], stdin=subprocess.PIPE) as node:
        watch = Watch(VCAN)
        first_s = watch.until(watch.fresh, 30.0)
        watch.until(lambda: len(watch.samples) > 100)
        report("plain", recovery_s=first_s, wrong_mm=watch.wrong_motion_mm(), counters=watch.counters())
        nothing: Callable[[], None] = lambda: None  # noqa: E731
        scenario(
            "interface_down", watch, lambda: shell("ip link set vcan0 down"), lambda: shell("ip link set vcan0 up"), 1.0
        )
        scenario(
            "interface_deleted",
            watch,
            lambda: shell("ip link del vcan0"),
            lambda: shell("ip link add vcan0 type vcan && ip link set vcan0 up"),
            1.0,
        )
        scenario("bus_off", watch, lambda: inject_error(0x40, bytes(8)), lambda: inject_error(0x100, bytes(8)), 0.3)
        scenario("passive", watch, lambda: inject_error(0x04, bytes((0, 0x30, 0, 0, 0, 0, 130, 20))), nothing, 0.1)
        scenario("burst", watch, burst, nothing, 0.5)
        scenario("clock", watch, lambda: time.clock_settime(time.CLOCK_REALTIME, time.time() + 3600), nothing, 0.5)
        report("events", kinds=sorted(watch.kinds))
        watch.encoders.close()
        assert node.stdin is not None
        node.stdin.close()


def on_slcan() -> None:
    leader, follower = pty.openpty()
    tty.setraw(leader)
    tty.setraw(follower)
    shell(f"slcand -o -s6 {os.ttyname(follower)} slcan0")
    for _ in range(100):
        if Path("/sys/class/net/slcan0").exists():
            break
        time.sleep(0.02)
    shell("ip link set slcan0 up")
    watch = Watch(BusSettings(interface="socketcan", channel="slcan0"))
    nodes = EncoderNodes(SimulatedWheelSettings(slip_std_per_m=0.0), EncoderSettings(), 0, np.random.default_rng(1))

    def send() -> bool:
        now_ns = time.monotonic_ns()
        for wheel, speed in ((Wheel.LEFT, LEFT_MPS), (Wheel.RIGHT, RIGHT_MPS)):
            for frame in nodes.beat(wheel, now_ns, now_ns * 1e-9 * speed):
                os.write(leader, f"t{frame.arbitration_id:03X}8{frame.data.hex().upper()}\r".encode())
        return sum(sample.valid for sample in watch.samples) >= 50

    first_s = watch.until(send)
    os.write(leader, b"t18ZZ\rt1812\xff\xfe\r")
    mark = len(watch.samples)
    after_s = watch.until(lambda: send() and len(watch.samples) > mark + 20)
    report(
        "slcan",
        recovery_s=first_s,
        after_junk_s=after_s,
        wrong_mm=watch.wrong_motion_mm(),
        counters=watch.counters(),
    )
    watch.encoders.close()


if __name__ == "__main__":
    load_modules(Path(sys.argv[1]))
    on_vcan()
    on_slcan()
