import errno
import inspect
import socket
import time
from collections.abc import Callable

import can
import pytest
from can.interfaces.udp_multicast.bus import GeneralPurposeUdpMulticastBus
from hypothesis import given
from hypothesis import strategies as st

from drivers.canbus.advice import advice, bitrate_advice, bus_off_advice
from drivers.canbus.arrival_clock import ArrivalClock
from drivers.canbus.bus import CanBus, frame_of, message_of, socket_of
from drivers.canbus.error_frames import BUS_OFF, CONTROLLER, NO_ACK, RESTARTED, BusCondition, ErrorFrames
from drivers.canbus.frame import ERROR, EXTENDED, FD, REMOTE, CanFrame
from drivers.canbus.loopback import LoopbackBus, LoopbackSocket, free_port
from drivers.measurements import LinkError
from drivers.settings.can import BusSettings

CAN0 = BusSettings(interface="socketcan", channel="can0")
VCAN0 = BusSettings(interface="socketcan", channel="vcan0")
SERIAL = BusSettings(interface="slcan", channel="/dev/ttyUSB0")


@pytest.mark.parametrize(
    ("bus", "number", "words"),
    [
        (CAN0, errno.EAFNOSUPPORT, "sudo modprobe can-raw"),
        (CAN0, errno.ENODEV, "sudo ip link set can0 up type can bitrate 500000"),
        (VCAN0, errno.ENODEV, "sudo ip link add vcan0 type vcan && sudo ip link set vcan0 up"),
        (CAN0, errno.ENETDOWN, "sudo ip link set can0 up type can bitrate 500000"),
        (VCAN0, errno.ENETDOWN, "sudo ip link set vcan0 up"),
        (CAN0, errno.EPERM, "RestrictAddressFamilies=AF_CAN"),
        (SERIAL, errno.EACCES, "sudo usermod -aG dialout"),
        (SERIAL, errno.ENOENT, "ls /dev"),
        (SERIAL, errno.EBUSY, "sudo fuser -v /dev/ttyUSB0"),
    ],
)
def test_each_way_a_bus_can_be_missing_is_one_sentence_with_its_command(
    bus: BusSettings, number: int, words: str
) -> None:
    text = advice(bus, OSError(number, "what the system says"))
    assert words in text
    assert bus.channel in text
    assert "\n" not in text


def test_the_number_is_found_through_python_can_s_wrapping() -> None:
    error = can.CanOperationError("Failed to receive", errno.ENETDOWN)
    assert "the interface is down" in advice(CAN0, error)
    outer = can.CanInitializationError("no")
    outer.__cause__ = PermissionError(errno.EACCES, "no")
    assert "no permission" in advice(SERIAL, outer)


def test_wrong_bit_rate_and_bus_off_name_the_command() -> None:
    assert "bitrate 500000" in bitrate_advice(CAN0)
    assert "restart-ms 100" in bus_off_advice(CAN0)


def test_an_absent_interface_raises_one_sentence_here_too() -> None:
    with pytest.raises(LinkError, match="sudo "):
        CanBus(BusSettings(interface="socketcan", channel="can_nowhere"), (), time.monotonic_ns)


def test_an_interface_python_can_does_not_know_lists_those_it_knows() -> None:
    with pytest.raises(LinkError, match=r"no such interface; .* one of .*, socketcan, "):
        CanBus(BusSettings(interface="telepathy", channel="x"), (), time.monotonic_ns)


def test_an_interface_whose_package_is_missing_says_how_to_get_it() -> None:
    error = can.CanInterfaceNotImplementedError("Cannot import module for interface 'gs_usb'")
    text = advice(BusSettings(interface="gs_usb", channel="0"), error)
    assert "pip install 'python-can[gs_usb]'" in text


def test_a_reader_on_port_0_is_told_to_give_the_port() -> None:
    with pytest.raises(LinkError, match="port 0 is for the simulated node"):
        CanBus(BusSettings(), (), time.monotonic_ns)


def test_kernel_without_can_is_recognised(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.EAFNOSUPPORT, "Address family not supported by protocol")

    monkeypatch.setattr(socket, "socket", refuse)
    with pytest.raises(LinkError, match="this kernel has no CAN"):
        CanBus(CAN0, (), time.monotonic_ns)


@given(
    number=st.integers(0, 0x7FF),
    data=st.binary(max_size=8),
    flags=st.sampled_from([0, EXTENDED, REMOTE, ERROR, FD, EXTENDED | FD]),
)
def test_frames_survive_python_can(number: int, data: bytes, flags: int) -> None:
    frame = CanFrame(7, number, b"" if flags & REMOTE else data, flags)
    assert frame_of(message_of(frame), 7) == frame


def test_warning_passive_off_and_restart_are_followed() -> None:
    errors = ErrorFrames()
    told = [
        (CONTROLLER, bytes((0, 0x08, 0, 0, 0, 0, 0, 0)), "warning", BusCondition.WARNING),
        (CONTROLLER, bytes((0, 0x20, 0, 0, 0, 0, 0, 0)), "passive", BusCondition.PASSIVE),
        (BUS_OFF, bytes(8), "bus_off", BusCondition.OFF),
        (RESTARTED, bytes(8), "restarted", BusCondition.ACTIVE),
    ]
    for error_class, data, name, condition in told:
        assert errors.error(error_class, data) == (name,)
        assert errors.condition is condition


def test_a_controller_that_was_off_is_active_with_the_first_good_frame_and_a_passive_one_after_ten() -> None:
    conditions = []
    for error_class, data in ((BUS_OFF, bytes(8)), (CONTROLLER, bytes((0, 0x30)))):
        errors = ErrorFrames()
        errors.error(error_class, data)
        good = 0
        while errors.condition is not BusCondition.ACTIVE:
            errors.good_frame()
            good += 1
        conditions.append(good)
    assert conditions == [1, 10]


def test_one_frame_can_tell_several_errors_and_a_short_one_does_no_harm() -> None:
    errors = ErrorFrames()
    assert errors.error(NO_ACK | BUS_OFF, b"") == ("no_ack", "bus_off")
    assert errors.error(CONTROLLER, b"") == ("unspecified",)


def stamps(clock: ArrivalClock, readings: list[tuple[int, float]]) -> list[int]:
    return [clock.stamp_ns(monotonic_ns, system_s) for monotonic_ns, system_s in readings]


@given(delays_ms=st.lists(st.floats(0.0, 15.0), min_size=30, max_size=60))
def test_a_late_reader_does_not_shift_the_stamps(delays_ms: list[float]) -> None:
    delays_ms[0] = 0.0
    readings = [(i * 20_000_000 + round(delay * 1e6), 1.7e9 + i * 0.02) for i, delay in enumerate(delays_ms)]
    times = stamps(ArrivalClock(), readings)
    # float seconds since 1970 resolve 0.24 us, and the offset may leak 1 ms in a second
    assert all(abs(time_ns - i * 20_000_000) < 1_500_000 for i, time_ns in enumerate(times))
    assert all(time_ns <= monotonic_ns for time_ns, (monotonic_ns, _) in zip(times, readings, strict=True))


@pytest.mark.parametrize("hours", [1.0, -1.0, 24.0])
def test_a_jump_of_the_system_clock_is_counted_and_changes_no_stamp(hours: float) -> None:
    clock = ArrivalClock()
    readings = [(i * 20_000_000, 1.7e9 + i * 0.02 + (hours * 3600 if i >= 50 else 0.0)) for i in range(100)]
    times = stamps(clock, readings)
    assert clock.jumps == 1
    assert all(abs(time_ns - i * 20_000_000) < 100_000 for i, time_ns in enumerate(times))


def test_a_bus_opened_anew_whose_first_frames_waited_keeps_its_clock() -> None:
    clock = ArrivalClock()
    stamps(clock, [(i * 20_000_000, 1.7e9 + i * 0.02) for i in range(50)])
    late = [(60 * 20_000_000, 1.7e9 + i * 0.02) for i in range(55, 60)]
    times = stamps(clock, late)
    assert all(abs(time_ns - i * 20_000_000) < 1_000_000 for i, time_ns in zip(range(55, 60), times, strict=True))


def test_a_bus_without_stamps_uses_the_arrival() -> None:
    assert ArrivalClock().stamp_ns(123, 0.0) == 123


def test_a_jump_of_the_clock_on_a_real_bus_is_only_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    shift: list[float] = [0.0]
    real: Callable[[], float] = time.time
    monkeypatch.setattr(time, "time", lambda: real() + shift[0])
    bus = BusSettings(interface="virtual", channel="clock jump")
    reader, writer = (CanBus(bus, (), time.monotonic_ns) for _ in range(2))
    try:
        received = []
        for beat in range(6):
            shift[0] = 3600.0 if beat >= 3 else 0.0
            writer.send(CanFrame(0, 0x181, bytes(8)))
            frame = reader.receive(120.0)
            assert frame is not None
            received.append(frame.stamp_ns)
        assert reader.clock_jumps == 1
        assert received[-1] - received[0] < 600 * 1_000_000_000, "an hour was not believed"
    finally:
        reader.close()
        writer.close()


def test_a_reader_that_was_held_up_stamps_its_queue_as_it_arrived_and_no_clock_has_jumped() -> None:
    clock, times = ArrivalClock(), []
    for i in range(150):
        read_ns = 2_000_000_000 + i * 100_000 if 50 <= i < 100 else i * 20_000_000
        times.append(clock.stamp_ns(read_ns, 1.7e9 + i * 0.02, 1_700_000_000_000_000_000 + read_ns))
    assert clock.jumps == 0
    assert all(abs(time_ns - i * 20_000_000) < 2_500_000 for i, time_ns in enumerate(times)), "but for the leak"


@pytest.mark.parametrize("jump_s", [0.7, -0.7, 3600.0, -3600.0])
def test_frames_that_waited_while_the_clock_jumped_keep_their_time(jump_s: float) -> None:
    clock, times = ArrivalClock(), []
    for i in range(100):
        read_ns = max(i * 20_000_000, 1_200_000_000) if i >= 50 else i * 20_000_000
        jumped_s = jump_s if i >= 55 else 0.0
        now_s = jump_s if i >= 50 else 0.0
        system_ns = 1_700_000_000_000_000_000 + read_ns + round(now_s * 1e9)
        times.append(clock.stamp_ns(read_ns, 1.7e9 + i * 0.02 + jumped_s, system_ns))
    assert clock.jumps == 1
    assert all(abs(time_ns - i * 20_000_000) < 1_000_000 for i, time_ns in enumerate(times))


def test_what_the_kernel_throws_away_is_counted() -> None:
    port = free_port()
    reader = CanBus(BusSettings(port=port, receive_buffer_bytes=4096), (), time.monotonic_ns)
    writer = CanBus(BusSettings(port=port), (), time.monotonic_ns)
    try:
        for _ in range(500):
            writer.send(CanFrame(0, 0x181, bytes(8)))
        kept = 0
        while reader.receive(0.2) is not None:
            kept += 1
        assert 0 < kept < 500
        assert reader.overflowed == 500 - kept
    finally:
        reader.close()
        writer.close()


REMEDIES = ("pip install", "install the vendor's driver", "sudo ", "plug in the adapter", "[encoders.bus")


@pytest.mark.parametrize("interface", sorted(can.VALID_INTERFACES))
def test_every_interface_of_python_can_is_a_bus_or_one_sentence_with_its_remedy(interface: str) -> None:
    udp = interface == "udp_multicast"
    channel = "239.74.163.2" if udp else "can_absent" if interface == "socketcan" else "/dev/absent"
    settings = BusSettings(interface=interface, channel=channel, port=free_port() if udp else 0)
    try:
        CanBus(settings, (0x181,), time.monotonic_ns).close()
    except LinkError as error:
        sentence = str(error)
        assert interface in sentence
        assert "\n" not in sentence
        assert any(remedy in sentence for remedy in REMEDIES), sentence
        assert "Traceback" not in sentence


def test_the_private_names_of_python_can_that_the_loopback_bus_replaces_are_still_those() -> None:
    replaced = inspect.signature(GeneralPurposeUdpMulticastBus._create_socket)
    assert inspect.signature(LoopbackSocket._create_socket) == replaced
    bus = LoopbackBus("239.74.163.2", free_port())
    try:
        assert bus.protocol is can.CanProtocol.CAN_FD
        sock = socket_of(bus)
        assert sock is not None
        with sock:
            assert sock.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, 4) == socket.inet_aton("127.0.0.1")
    finally:
        bus.shutdown()


def test_a_bus_without_a_socket_has_none() -> None:
    with can.Bus(interface="virtual", channel="no socket") as bus:
        assert socket_of(bus) is None
