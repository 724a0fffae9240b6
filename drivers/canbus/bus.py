"""One CAN bus through python-can: opened with filters and a large buffer, read as frames, errors as sentences."""

import logging
import os
import socket
import struct
import time
from collections.abc import Callable, Iterable
from typing import Any

import can

from drivers.canbus.advice import advice, error_number
from drivers.canbus.arrival_clock import ArrivalClock
from drivers.canbus.frame import ERROR, EXTENDED, FD, REMOTE, CanFrame
from drivers.canbus.loopback import LoopbackBus
from drivers.measurements import LinkError, ProtocolError
from drivers.settings.can import BusSettings

WITHOUT_BITRATE = ("socketcan", "virtual", "udp_multicast", "socketcand")
SO_MEMINFO, MEMINFO, DROPPED = 55, struct.Struct("=9I"), 8  # Linux 4.12: counters of a socket, the last its drops
SO_RCVBUFFORCE = 33  # asm-generic/socket.h; needs CAP_NET_ADMIN, else SO_RCVBUF up to net.core.rmem_max
MOST_ID, MOST_BYTES = 0x1FFFFFFF, 64  # 29 bits; a frame of CAN FD
NOT_A_FRAME = (TypeError, ValueError, LookupError, ArithmeticError, AttributeError)  # raised of what was sent
FILTERED_IN_KERNEL = ("socketcan",)  # python-can's own filter in other back ends would drop error frames


class CanBus:
    """An open bus. Raises LinkError with the command that mends it when it cannot be opened.

    ids: all that is wanted, where the system can filter; None: every frame.
    clock: kept over sessions by a caller that opens again, since the first frames of a session are read late.
    system_now_ns: the clock that the kernel stamps frames with; only looked at to tell its jumps from late reading.
    """

    def __init__(
        self,
        settings: BusSettings,
        ids: Iterable[int] | None,
        now_ns: Callable[[], int],
        clock: ArrivalClock | None = None,
        system_now_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self.settings = settings
        self._now_ns = now_ns
        self._system_now_ns = system_now_ns
        self._clock = clock if clock is not None else ArrivalClock()
        try:
            self._bus = open_bus(settings, ids)
        except Exception as error:  # back ends raise whatever their vendor's library raises
            raise LinkError(advice(settings, error)) from error
        self._socket = socket_of(self._bus)
        self._enlarge_buffer()

    @property
    def clock_jumps(self) -> int:
        """How often the system clock has jumped against the monotonic one."""
        return self._clock.jumps

    @property
    def overflowed(self) -> int:
        """Frames that the kernel has thrown away since the bus was opened because its buffer was full; 0 if unknown.

        python-can does not ask for SO_RXQ_OVFL and cannot bear its answer.
        """
        if self._socket is None:
            return 0
        try:
            return int(MEMINFO.unpack(self._socket.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, MEMINFO.size))[DROPPED])
        except (OSError, struct.error):
            return 0

    def receive(self, timeout_s: float) -> CanFrame | None:
        """The next frame, None after the timeout.

        Raises LinkError; its `number` says which error of the system it was, None for one of the library. Raises
        NotAFrameError for what somebody sent that is none: the bus is not to blame.
        """
        try:
            message = self._bus.recv(timeout_s)
        except Exception as error:  # back ends raise whatever their vendor's library raises
            number = error_number(error)
            if number is None and (isinstance(error, NOT_A_FRAME) or self.settings.interface == "udp_multicast"):
                raise NotAFrameError(self.settings, error.__cause__ or error) from error
            raise BusReadError(advice(self.settings, error), number) from error
        if message is None:
            return None
        try:
            return frame_of(message, self._clock.stamp_ns(self._now_ns(), message.timestamp, self._system_now_ns()))
        except NOT_A_FRAME as error:  # udp_multicast fills a message with whatever types a datagram has
            raise NotAFrameError(self.settings, error) from error

    def send(self, frame: CanFrame, timeout_s: float = 0.1) -> None:
        """Send one frame. Raises LinkError; never waits longer than the timeout."""
        try:
            self._bus.send(message_of(frame), timeout_s)
        except Exception as error:
            raise BusReadError(advice(self.settings, error), error_number(error)) from error

    def close(self) -> None:
        """Leave the bus; a bus that cannot even be closed is left to the system."""
        if self._socket is not None:
            self._socket.close()
        try:
            self._bus.shutdown()
        except Exception:
            logging.getLogger(__name__).debug("closing %s failed", self.settings.channel, exc_info=True)

    def _enlarge_buffer(self) -> None:
        if self._socket is None:
            return
        for option in (SO_RCVBUFFORCE, socket.SO_RCVBUF):
            try:
                self._socket.setsockopt(socket.SOL_SOCKET, option, self.settings.receive_buffer_bytes)
            except OSError:
                continue
            return


class NotAFrameError(ProtocolError):
    """Something on the bus sent bytes that are no frame: a datagram of another program, a broken line of slcan."""

    def __init__(self, settings: BusSettings, error: BaseException) -> None:
        what = " ".join(f"{type(error).__name__}: {error}".split())[:100]
        super().__init__(
            f"CAN bus {settings.interface} {settings.channel}: something that is not a frame arrived and "
            f"was ignored ({what}); find the program that sends it"
        )


class BusReadError(LinkError):
    """The bus failed while it was open. number: errno, None where there is none."""

    def __init__(self, text: str, number: int | None) -> None:
        super().__init__(text)
        self.number = number


def socket_of(bus: can.BusABC) -> socket.socket | None:
    """Another handle to the socket of a bus that is one, for its options; None for an adapter or a queue."""
    try:
        descriptor = os.dup(bus.fileno())
    except (OSError, NotImplementedError):
        return None
    try:
        return socket.socket(fileno=descriptor)
    except OSError:  # a serial port, for example
        os.close(descriptor)
        return None


def open_bus(settings: BusSettings, ids: Iterable[int] | None) -> can.BusABC:
    """python-can's bus for these settings; udp_multicast is held to the loopback unless its options say otherwise."""
    logging.getLogger("can").setLevel(logging.CRITICAL)  # it would print on every attempt what the exception says
    arguments: dict[str, Any] = dict(settings.options)
    if settings.interface == "udp_multicast":
        if settings.port == 0:
            raise ValueError("port 0 is for the simulated node, which picks a port and passes it on; give its port")
        if "hop_limit" not in arguments and "." in settings.channel:
            return LoopbackBus(settings.channel, settings.port)
        arguments["port"] = settings.port
    if settings.interface not in WITHOUT_BITRATE:
        arguments.setdefault("bitrate", settings.bitrate)
    if settings.interface in FILTERED_IN_KERNEL and ids is not None:
        # without the frame format, so that a frame in the wrong one is seen and counted
        arguments["can_filters"] = [{"can_id": number, "can_mask": 0x1FFFFFFF} for number in ids]
    return can.Bus(channel=settings.channel, interface=settings.interface, ignore_config=True, **arguments)


def frame_of(message: can.Message, stamp_ns: int) -> CanFrame:
    """A frame as plain values; the class of an error frame stands in its id. Raises ValueError, TypeError for values
    that no frame has.
    """
    bits = (message.is_extended_id, message.is_remote_frame, message.is_error_frame, message.is_fd)
    number, data = message.arbitration_id, message.data
    if any(bit not in (0, 1) for bit in bits) or not isinstance(number, int):
        raise TypeError(f"id {number!r} with the marks {bits!r}")
    if not isinstance(data, bytes | bytearray) or not 0 <= number <= MOST_ID or len(data) > MOST_BYTES:
        raise ValueError(f"id {number!r} with {len(data)} bytes")
    flags = sum(mark for bit, mark in zip(bits, (EXTENDED, REMOTE, ERROR, FD), strict=True) if bit)
    return CanFrame(stamp_ns, number, bytes(data), flags)


def message_of(frame: CanFrame) -> can.Message:
    """python-can's message for a frame."""
    return can.Message(
        arbitration_id=frame.arbitration_id,
        data=frame.data,
        is_extended_id=bool(frame.flags & EXTENDED),
        is_remote_frame=bool(frame.flags & REMOTE),
        is_error_frame=bool(frame.flags & ERROR),
        is_fd=bool(frame.flags & FD),
        check=False,
    )
