"""The reader on real python-can buses: virtual, udp_multicast between processes, slcan over a pseudo-terminal."""

import itertools
import json
import os
import pty
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from drivers.canbus.bus import CanBus
from drivers.canbus.frame import CanFrame
from drivers.measurements import Encoders, Event, SensorState, WheelCounts
from drivers.settings.can import BusSettings
from drivers.settings.encoders import EncoderSettings
from drivers.settings.layouts import Cia406Layout
from drivers.settings.simulated_wheels import SimulatedWheelSettings
from drivers.simulated.wheels.node import WheelNode
from drivers.wheels import encoders as encoders_module
from drivers.wheels.encoders import CanEncoders
from drivers.wheels.readings import Wheel
from tests.support.drivers.candump import read_candump
from tests.support.drivers.waiting import wait_until

NOISELESS = SimulatedWheelSettings(slip_std_per_m=0.0)
COUNTS_PER_METRE = EncoderSettings().counts_per_metre
LEFT_MPS, RIGHT_MPS = 1.0, 1.2

BUSES = itertools.count()  # no two tests share a bus


def virtual_bus() -> BusSettings:
    return BusSettings(interface="virtual", channel=f"encoders {next(BUSES)}")


def straight(stamp_ns: int) -> tuple[float, float]:
    """An unstarted course: what the wheels rolled since the monotonic clock began."""
    return stamp_ns * 1e-9 * LEFT_MPS, stamp_ns * 1e-9 * RIGHT_MPS


class Listener:
    """Drains a reader and keeps what it gave."""

    def __init__(self, encoders: CanEncoders) -> None:
        self.encoders = encoders
        self.samples: list[WheelCounts] = []
        self.events: list[Event] = []

    def hear(self) -> list[WheelCounts]:
        self.samples += self.encoders.drain()
        self.events += self.encoders.drain_events()
        return self.samples

    def fresh(self) -> bool:
        """True once a valid sample has come since the call before."""
        known = len(self.samples)
        return any(sample.valid for sample in self.hear()[known:])


class Tap:
    def __init__(self) -> None:
        self.frames: list[tuple[int, int, bytes]] = []

    def laser_bytes(self, stamp_ns: int, sent: bool, data: bytes) -> None:
        raise AssertionError

    def can_frame(self, stamp_ns: int, arbitration_id: int, flags: int, data: bytes) -> None:
        self.frames.append((arbitration_id, flags, data))


@contextmanager
def pair_on(bus: BusSettings, tap: Tap | None = None) -> Iterator[tuple[WheelNode, Listener]]:
    """A node that is heard from its first frame on."""
    node = WheelNode(NOISELESS, EncoderSettings(bus=bus), straight, time.monotonic_ns, np.random.default_rng(1))
    encoders = CanEncoders(EncoderSettings(bus=node.bus), time.monotonic_ns, tap)
    encoders.start()
    assert wait_until(lambda: encoders.health().counters.get("bus.sessions", 0) >= 1)
    node.start()
    try:
        yield node, Listener(encoders)
    finally:
        encoders.close()
        node.close()


def assert_true_motion(samples: list[WheelCounts], slack_m: float = 0.02) -> None:
    """Both totals follow the course, up to what a thread that was woken late drove meanwhile: its stamps tell."""
    valid = [sample for sample in samples if sample.valid]
    first, last = valid[0], valid[-1]
    elapsed_s = (last.stamp_ns - first.stamp_ns) * 1e-9
    slack_m += RIGHT_MPS * max(b.stamp_ns - a.stamp_ns for a, b in pairwise(samples)) * 1e-9
    assert (last.left - first.left) / COUNTS_PER_METRE == pytest.approx(LEFT_MPS * elapsed_s, abs=slack_m)
    assert (last.right - first.right) / COUNTS_PER_METRE == pytest.approx(RIGHT_MPS * elapsed_s, abs=slack_m)
    assert all(a.stamp_ns < b.stamp_ns for a, b in pairwise(samples))


def test_the_reader_satisfies_the_seam() -> None:
    encoders: Encoders = CanEncoders(EncoderSettings(bus=virtual_bus()), time.monotonic_ns)
    assert encoders.drain() == ()
    assert encoders.health().state is SensorState.STARTING


@pytest.mark.parametrize("bus", [virtual_bus(), BusSettings()], ids=["virtual", "udp_multicast"])
def test_both_wheels_come_through_a_bus_at_common_instants(bus: BusSettings) -> None:
    with pair_on(bus) as (_, listener):
        assert wait_until(lambda: len(listener.hear()) >= 40)
        assert_true_motion(listener.samples)
        assert (listener.samples[0].left, listener.samples[0].right) == (0.0, 0.0)
        health = listener.encoders.health()
    assert health.state is SensorState.FRESH
    assert health.rate_hz > 0


def test_two_rovers_side_by_side_do_not_hear_each_other() -> None:
    with pair_on(BusSettings()) as (one, first), pair_on(BusSettings()) as (two, second):
        assert one.bus.port != two.bus.port
        assert wait_until(lambda: len(first.hear()) >= 20 and len(second.hear()) >= 20)
        for listener in (first, second):
            assert listener.encoders.health().counters.get("left.duplicate", 0) == 0
            assert_true_motion(listener.samples)


CHILD = """
import sys, time, json, numpy as np
from drivers.simulated.wheels.node import WheelNode
from drivers.settings.simulated_wheels import SimulatedWheelSettings
from drivers.settings.encoders import EncoderSettings
node = WheelNode(SimulatedWheelSettings(slip_std_per_m=0.0), EncoderSettings(),
                 lambda t: (t * 1e-9, t * 1.2e-9), time.monotonic_ns, np.random.default_rng(1))
node.start()
print(node.bus.model_dump_json(), flush=True)
sys.stdin.read()
node.close()
"""


def start_child(prefix: list[str]) -> "subprocess.Popen[str]":
    command = [*prefix, sys.executable, "-c", CHILD]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def test_a_node_in_another_process_is_heard_over_udp_multicast_and_its_end_is_noticed() -> None:
    with start_child([]) as child:
        assert child.stdout is not None
        bus = BusSettings.model_validate(json.loads(child.stdout.readline()))
        encoders = CanEncoders(EncoderSettings(bus=bus), time.monotonic_ns)
        listener = Listener(encoders)
        encoders.start()
        try:
            assert wait_until(lambda: len(listener.hear()) >= 30)
            assert_true_motion(listener.samples)
            child.kill()
            child.wait()
            assert wait_until(lambda: encoders.health().state is SensorState.FAILED)
            assert wait_until(lambda: any(not sample.valid for sample in listener.hear()))
        finally:
            encoders.close()


def test_udp_multicast_needs_no_network_but_the_loopback() -> None:
    enter = ["unshare", "--net", "sh", "-c", 'ip link set lo up && exec "$@"', "sh"]
    if subprocess.run([*enter, "true"], capture_output=True, check=False).returncode:
        pytest.skip("no permission to make a network namespace (unshare --net)")
    script = CHILD.replace(
        "print(",
        "from drivers.wheels.encoders import CanEncoders\n"
        "from drivers.settings.encoders import EncoderSettings\n"
        "encoders = CanEncoders(EncoderSettings(bus=node.bus), time.monotonic_ns)\n"
        "encoders.start()\nsamples = []\n"
        "deadline = time.monotonic() + 120\n"
        "while len(samples) < 10 and time.monotonic() < deadline:\n"
        "    samples += encoders.drain(); time.sleep(0.01)\n"
        "encoders.close(); node.close(); print(len(samples)); sys.exit(0)\nprint(",
        1,
    )
    answer = subprocess.run([*enter, sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr
    assert int(answer.stdout) >= 10


@pytest.mark.parametrize(
    ("fault", "counter"),
    [
        ({"kind": "silence", "wheel": "right"}, "right.lost"),
        ({"kind": "silence_all", "wheel": "both"}, "bus.silent"),
        ({"kind": "bad_crc"}, "left.crc"),
        ({"kind": "bus_off", "wheel": "both"}, "bus.bus_off"),
        ({"kind": "error_flood", "wheel": "both"}, "bus.bus_error"),
        ({"kind": "power_cycle"}, "left.power_cycle"),
        ({"kind": "second_sender", "value": 9}, "left.two_senders"),
    ],
)
def test_a_fault_while_running_fails_the_sensor_and_it_is_back_after_its_end(
    fault: dict[str, object], counter: str
) -> None:
    with pair_on(virtual_bus()) as (node, listener):
        assert wait_until(listener.fresh)
        node.inject(fault)
        seconds = 0.75 if fault["kind"] == "silence_all" else 0.45
        began = time.monotonic()
        assert wait_until(lambda: listener.encoders.health().state is SensorState.FAILED)
        assert wait_until(lambda: listener.hear() and time.monotonic() - began > seconds)
        assert not listener.samples[-1].valid
        node.clear()
        assert wait_until(lambda: listener.encoders.health().state is SensorState.FRESH and listener.fresh())
        assert listener.encoders.health().counters[counter] > 0
        assert listener.events


def test_a_node_with_other_counts_per_turn_is_refused_by_name() -> None:
    settings = NOISELESS.model_copy(update={"counts_per_rev": 2048})
    bus = virtual_bus()
    node = WheelNode(settings, EncoderSettings(bus=bus), straight, time.monotonic_ns, np.random.default_rng(1))
    encoders = CanEncoders(EncoderSettings(bus=bus), time.monotonic_ns)
    encoders.start()
    node.start()
    try:
        assert wait_until(lambda: encoders.health().state is SensorState.FAILED and "2048" in encoders.health().reason)
        assert "counts_per_rev is 4096" in encoders.health().reason
    finally:
        encoders.close()
        node.close()


def test_a_burst_of_three_thousand_frames_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(encoders_module, "SILENCE_S", 1e9)  # the bus is not opened anew where the node is held up
    tap = Tap()
    with pair_on(BusSettings(), tap) as (node, listener):
        assert wait_until(listener.fresh)
        node.inject({"kind": "burst", "magnitude": 3000})
        assert wait_until(lambda: node.frames_sent > 3000)
        mark = node.frames_sent
        assert wait_until(lambda: listener.hear() and node.frames_sent > mark + 40)
        node.close()
        assert wait_until(lambda: len(tap.frames) == node.frames_sent)
        listener.hear()
        counters = listener.encoders.health().counters
        assert_true_motion(listener.samples, 0.05)
    assert counters.get("bus.overflow", 0) == 0
    # "lost" is no witness: what a node that is held up leaves out is missing like what is lost on the way
    assert not any(counters.get(f"{wheel}.{refused}") for wheel in Wheel for refused in ("crc", "not_available"))


def test_an_interface_that_is_not_there_is_tried_again_and_named_with_its_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(encoders_module, "BACKOFF_MAX_S", 0.05)
    bus = BusSettings(interface="socketcan", channel="vcan_absent"[:15])
    encoders = CanEncoders(EncoderSettings(bus=bus), time.monotonic_ns)
    encoders.start()
    try:
        assert wait_until(lambda: encoders.health().counters.get("bus.open", 0) >= 3)
        health = encoders.health()
        events = encoders.drain_events()
    finally:
        encoders.close()
    assert health.state is SensorState.FAILED
    assert "sudo" in health.reason
    assert len(events) == 1, "the log is not flooded by attempts"


def test_a_bus_that_comes_later_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(encoders_module, "BACKOFF_MAX_S", 0.05)
    leader, follower = pty.openpty()
    tty.setraw(leader)
    path = os.ttyname(follower)
    link = tmp_path / "adapter"
    bus = BusSettings(
        interface="slcan",
        channel=str(link),
        options={"sleep_after_open": 0.0, "timeout": 0.01},
    )
    encoders = CanEncoders(EncoderSettings(bus=bus), time.monotonic_ns)
    listener = Listener(encoders)
    encoders.start()
    try:
        assert wait_until(lambda: encoders.health().counters.get("bus.open", 0) >= 2)
        assert "plug in the adapter" in encoders.health().reason
        link.symlink_to(path)
        assert wait_until(lambda: encoders.health().counters.get("bus.sessions", 0) >= 1)
        send_slcan(leader, listener, 10)
        # a byte that is no text poisons python-can's buffer for good; only a new session helps
        os.write(leader, b"\xff\xfe")
        send_slcan(leader, listener, 10)
        assert encoders.health().counters["bus.sessions"] >= 2
        os.write(leader, b"t18ZZ\r")
        send_slcan(leader, listener, 10)
    finally:
        encoders.close()
        link.unlink()
        os.close(leader)
        os.close(follower)


def send_slcan(leader: int, listener: Listener, wanted: int) -> None:
    """Send good frames of both wheels at rest until that many more samples have come."""
    before = sum(sample.valid for sample in listener.samples)
    beat = 0
    feedback = NODES_AT_REST
    deadline = time.monotonic() + 120.0
    while sum(sample.valid for sample in listener.hear()) < before + wanted:
        assert time.monotonic() < deadline, listener.encoders.health()
        for frame in feedback(beat):
            line = f"t{frame.arbitration_id:03X}{len(frame.data)}{frame.data.hex().upper()}\r"
            os.write(leader, line.encode())
        beat += 1
        time.sleep(0.02)


def nodes_at_rest() -> Callable[[int], list[CanFrame]]:
    from drivers.simulated.wheels.encoder_nodes import EncoderNodes
    from drivers.wheels.readings import Wheel

    nodes = EncoderNodes(NOISELESS, EncoderSettings(), 0, np.random.default_rng(1))
    return lambda beat: [frame for wheel in Wheel for frame in nodes.beat(wheel, beat * 20_000_000, 0.0)]


NODES_AT_REST = nodes_at_rest()


def test_every_frame_of_a_wire_reaches_the_tap_before_it_is_judged() -> None:
    tap, bus = Tap(), virtual_bus()
    encoders = CanEncoders(EncoderSettings(bus=bus), time.monotonic_ns, tap)
    encoders.start()
    assert wait_until(lambda: encoders.health().counters.get("bus.sessions", 0) >= 1)
    sender = CanBus(bus, (), time.monotonic_ns)
    sent = [(0x181, 0, b"12345678"), (0x999, 1, b"xyz"), (0x004, 4, bytes(8)), (0x123, 2, b"")]
    try:
        for number, flags, data in sent:
            sender.send(CanFrame(0, number, data, flags))
        assert wait_until(lambda: len(tap.frames) >= len(sent))
    finally:
        encoders.close()
        sender.close()
    assert tap.frames == sent


def test_a_recorded_candump_sent_over_the_bus_arrives_whole(recorded_data: Callable[[str], Path]) -> None:
    frames = list(read_candump(recorded_data("can_encoder") / "infant_candump.log"))
    bus, tap = virtual_bus(), Tap()
    encoders = CanEncoders(EncoderSettings(bus=bus), time.monotonic_ns, tap)
    encoders.start()
    assert wait_until(lambda: encoders.health().counters.get("bus.sessions", 0) >= 1)
    sender = CanBus(bus, (), time.monotonic_ns)
    try:
        for frame in frames:
            sender.send(frame)
        assert wait_until(lambda: len(tap.frames) >= len(frames))
        # the last one is an error frame, whose class python-can's reader drops
        assert wait_until(lambda: encoders.health().counters.get("bus.unspecified", 0) == 1)
    finally:
        sender.close()
        encoders.close()
    assert tap.frames == [(frame.arbitration_id, frame.flags, frame.data) for frame in frames]


def test_canopen_nodes_are_started_when_the_bus_opens_and_after_a_boot_up() -> None:
    pytest.importorskip("canopen", reason="the extra canopen is not installed")
    bus = virtual_bus()
    node = CanBus(bus, (), time.monotonic_ns)
    settings = EncoderSettings(bus=bus, layout=Cia406Layout(kind="cia406", left_node=5, right_node=6))
    encoders = CanEncoders(settings, time.monotonic_ns)
    encoders.start()

    def next_two() -> list[tuple[int, bytes]]:
        received = [node.receive(120.0) for _ in range(2)]
        return [(frame.arbitration_id, frame.data) for frame in received if frame is not None]

    try:
        assert next_two() == [(0, b"\x01\x05"), (0, b"\x01\x06")]
        node.send(CanFrame(0, 0x705, b"\0"))
        assert next_two() == [(0, b"\x01\x05"), (0, b"\x01\x06")]
    finally:
        encoders.close()
        node.close()


def test_close_returns_while_the_bus_is_silent() -> None:
    encoders = CanEncoders(EncoderSettings(bus=BusSettings(interface="virtual", channel="quiet")), time.monotonic_ns)
    encoders.start()
    encoders.close()
    assert not [thread for thread in threading.enumerate() if thread.name == "encoders"]
