"""Nothing that arrives on the bus, and nothing that is raised in it, ends the reader's thread."""

import socket
import time

import msgpack
import pytest

from drivers.canbus.frame import CanFrame
from drivers.canbus.loopback import free_port
from drivers.measurements import SensorState
from drivers.settings.can import BusSettings
from drivers.settings.encoders import EncoderSettings
from drivers.wheels import encoders as encoders_module
from drivers.wheels.encoders import CanEncoders
from tests.drivers.wheels.test_encoders import Listener, pair_on, virtual_bus
from tests.support.drivers.raising import OutOfNowhere, raise_in
from tests.support.drivers.waiting import wait_until

KILLS = 3
GROUP = "239.74.163.2"
FRAME = {
    "timestamp": 0.0,
    "arbitration_id": 0x181,
    "is_extended_id": False,
    "is_remote_frame": False,
    "is_error_frame": False,
    "channel": None,
    "dlc": 8,
    "data": b"12345678",
    "is_fd": False,
    "bitrate_switch": False,
    "error_state_indicator": False,
}
DATAGRAMS = [
    b"",
    b"not msgpack at all",
    msgpack.packb([1, 2, 3]),
    *(
        msgpack.packb(FRAME | change)
        for change in (
            {"is_extended_id": None},
            {"is_error_frame": "yes"},
            {"arbitration_id": -1},
            {"arbitration_id": 1.5},
            {"arbitration_id": "left"},
            {"data": None},
            {"data": "text", "dlc": 4},
            {"data": bytes(200), "dlc": 200},
            {"dlc": 1e300},
            {"check": False},
            {"timestamp": "now"},
        )
    ),
    b"\x81" * 4000,
]


def heard_again(listener: Listener) -> bool:
    return listener.fresh() and listener.encoders.health().state is SensorState.FRESH


def defects(listener: Listener) -> int:
    return listener.encoders.health().counters.get("bus.defects", 0)


@pytest.mark.parametrize("error", [OutOfNowhere, SystemExit])
def test_whatever_is_raised_in_the_thread_is_named_and_over_soon(error: type[BaseException]) -> None:
    with pair_on(virtual_bus()) as (_, listener):
        for kill in range(KILLS):
            assert wait_until(lambda: heard_again(listener))
            raise_in("encoders", error)
            assert wait_until(lambda kills=kill: defects(listener) > kills)  # type: ignore[misc]
            assert wait_until(lambda: heard_again(listener))
        assert defects(listener) == KILLS
        told = [event.reason for event in listener.events if "defect in the encoders' driver" in event.reason]
        assert told
        assert all(error.__name__ in reason for reason in told)


def test_datagrams_that_are_no_frames_are_counted_and_cost_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(encoders_module, "SILENCE_S", 1e9)  # a node that is held up opens no session anew
    bus = BusSettings(interface="udp_multicast", channel=GROUP, port=free_port())
    with pair_on(bus) as (_, listener), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        assert wait_until(lambda: heard_again(listener))
        sessions = listener.encoders.health().counters["bus.sessions"]
        for _ in range(20):
            for datagram in DATAGRAMS:
                sender.sendto(datagram, (GROUP, bus.port))
            time.sleep(0.02)
        assert wait_until(lambda: listener.encoders.health().counters.get("bus.not_a_frame", 0) >= 200)
        assert wait_until(lambda: heard_again(listener))
        health = listener.encoders.health()
        assert (health.counters["bus.sessions"], health.counters.get("bus.defects", 0)) == (sessions, 0)
        assert any("is not a frame" in event.reason for event in listener.events)


def test_a_reader_that_has_not_begun_is_starting_and_has_not_failed() -> None:
    health = CanEncoders(EncoderSettings(), time.monotonic_ns).health()
    assert (health.state, health.reason) == (SensorState.STARTING, "opening udp_multicast 239.74.163.2")


class FloodedBus:
    """Always has a frame of a stranger, 0.1 ms after the one before; the kernel throws others away."""

    clock_jumps = 0

    def __init__(self, *_: object) -> None:
        self.received = 0

    @property
    def overflowed(self) -> int:
        return self.received

    def receive(self, _timeout_s: float) -> CanFrame:
        self.received += 1
        return CanFrame(self.received * 100_000, 0x7, bytes(8))

    def send(self, _frame: CanFrame) -> None:
        pass


def test_who_floods_the_bus_gets_no_more_than_two_thousand_frames_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """The reader never waited: on a busy machine it kept the interpreter from the loop, which missed beats."""
    bus, waits = FloodedBus(), list[float]()
    encoders = CanEncoders(EncoderSettings(bus=virtual_bus()), lambda: bus.received * 100_000)
    monkeypatch.setattr(encoders._thread, "is_stopping", lambda: bus.received >= 20_000)
    monkeypatch.setattr(encoders._thread, "wait", waits.append)
    assert encoders._read(bus, 1.0)  # type: ignore[arg-type]
    taken_s = 20_000 * 100e-6
    assert sum(waits) > 18_000 / 2000 - taken_s  # all but those before the first look at what was thrown away
    assert max(waits) < 0.1  # the wheels are judged meanwhile
    assert encoders.health().counters["bus.overflow"] > 0
