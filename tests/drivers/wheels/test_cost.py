"""The figures: what reading the wheels costs, in processor time of this process."""

import subprocess
import sys
import time
from pathlib import Path

import can
import pytest

from drivers.canbus.bus import CanBus, message_of
from drivers.canbus.frame import CanFrame
from drivers.canbus.loopback import free_port
from drivers.settings.can import BusSettings
from drivers.settings.encoders import EncoderSettings
from drivers.wheels.encoders import CanEncoders
from drivers.wheels.pair import WheelPair
from drivers.wheels.readings import WheelReading
from tests.support.drivers.virtual_drive import FRAMES, SETTINGS, VirtualDrive
from tests.support.drivers.waiting import wait_until

pytestmark = pytest.mark.bench
FRAMES_PER_S = 100
PART_OF_A_CORE = 0.005
REPLAYED_PER_S = 20_000


@pytest.fixture(scope="module")
def frames() -> list[CanFrame]:
    drive = VirtualDrive(3)
    drive.run(100.0)
    return drive.frames


def feed(frames: list[CanFrame]) -> tuple[float, WheelPair]:
    """Processor seconds for all frames, the best of three, and the reader's state."""
    best = float("inf")
    for _ in range(3):
        pair = WheelPair(SETTINGS, FRAMES)
        start_s = time.process_time()
        for frame in frames:
            pair.feed(frame)
        best = min(best, time.process_time() - start_s)
    return best, pair


def test_decoding_and_unwrapping_both_wheels_takes_less_than_half_a_percent_of_a_core(
    frames: list[CanFrame],
) -> None:
    seconds, _ = feed(frames)
    assert seconds / len(frames) * FRAMES_PER_S < PART_OF_A_CORE


def test_twenty_thousand_frames_a_second_are_decoded_without_loss(frames: list[CanFrame]) -> None:
    seconds, pair = feed(frames)
    assert len(frames) / seconds > REPLAYED_PER_S
    assert pair.left.counters["lost"] == pair.right.counters["lost"] == 0


def test_a_recording_sent_as_fast_as_the_bus_takes_it_loses_no_frame(frames: list[CanFrame]) -> None:
    bus = BusSettings(interface="virtual", channel="recording")
    taken = 0

    class Tap:
        def laser_bytes(self, stamp_ns: int, sent: bool, data: bytes) -> None:
            raise AssertionError

        def can_frame(self, stamp_ns: int, arbitration_id: int, flags: int, data: bytes) -> None:
            nonlocal taken
            taken += 1

    encoders = CanEncoders(EncoderSettings(bus=bus), time.monotonic_ns, Tap())
    encoders.start()
    assert wait_until(lambda: encoders.health().counters.get("bus.sessions", 0) >= 1)
    sender = CanBus(bus, (), time.monotonic_ns)
    try:
        for frame in frames:
            sender.send(frame)
        assert wait_until(lambda: taken == len(frames))
    finally:
        encoders.close()
        sender.close()


SENDER = """
import sys, time
from pathlib import Path
from drivers.canbus.bus import CanBus
from drivers.settings.can import BusSettings
from tests.support.drivers.candump import replay_candump
bus = CanBus(BusSettings(port=int(sys.argv[2])), (), time.monotonic_ns)
start = time.monotonic()
sent = replay_candump(Path(sys.argv[1]), bus, speed=200.0)
print(sent / (time.monotonic() - start))
bus.close()
"""


def test_a_candump_at_two_hundred_times_its_speed_arrives_whole_over_multicast(
    frames: list[CanFrame], tmp_path: Path
) -> None:
    log = tmp_path / "drive.log"
    with can.CanutilsLogWriter(log) as writer:
        for sent in frames:
            message = message_of(sent)
            message.timestamp = sent.stamp_ns * 1e-9
            writer(message)
    port = free_port()
    bus = CanBus(BusSettings(port=port), (), time.monotonic_ns)
    readings = 0
    with subprocess.Popen([sys.executable, "-c", SENDER, str(log), str(port)], stdout=subprocess.PIPE) as sender:
        try:
            frame = bus.receive(10.0)
            while frame is not None:
                readings += sum(isinstance(item, WheelReading) for item in FRAMES.decode(frame))
                frame = bus.receive(1.0)
        finally:
            bus.close()
        assert sender.stdout is not None
        rate = float(sender.stdout.read())
    assert readings == sum(frame.arbitration_id in (0x181, 0x182) for frame in frames)
    assert rate > 0.5 * REPLAYED_PER_S, f"the sender reached only {rate:.0f} frames/s: the figure was not tried"
