"""A conversation over an open link: one command at a time, its reply found among whatever else arrives."""

import time
from collections.abc import Callable

from drivers.laser.link import ByteLink
from drivers.measurements import LinkError, RawTap
from drivers.scip.codec import END, LF, Message, ScipError, parse_message
from drivers.scip.framing import MessageStream, RawMessage

QUIET_S = 0.14  # no pause inside a message is so long
NS_A_BYTE = 250  # 4 MB a second are read, twice what 40 multi-echo scans have
MESSAGE_BYTES = 400  # that a message costs besides: pairs of line feeds alone would come by the million
BURST_NS, LONGEST_PAUSE_NS, LONGEST_DEBT_NS = 100_000_000, 200_000_000, 1_000_000_000


class ScipClient:
    """Used by one thread. `is_closing` is asked before every wait, so that closing takes no longer than one."""

    def __init__(
        self,
        link: ByteLink,
        tap: RawTap | None,
        now_ns: Callable[[], int],
        is_closing: Callable[[], bool],
        pause: Callable[[float], object] = time.sleep,
    ) -> None:
        """pause: waits so many seconds, and a link that floods waits too: it would take a core, and the disk."""
        self._link = link
        self._pause = pause
        self._due_ns = 0
        self._tap = tap
        self._now_ns = now_ns
        self._is_closing = is_closing
        self._stream = MessageStream()
        self.received_bytes = 0
        self.last_bytes = b""

    def send(self, command: bytes) -> None:
        """Send a command with its line feed. Raises LinkError."""
        line = command + LF
        if self._tap is not None:
            self._tap.laser_bytes(self._now_ns(), True, line)
        self._link.write(line)

    def receive(self, timeout_s: float) -> list[RawMessage]:
        """Messages that are whole by now; [] after timeout_s of silence or in the middle of one. Raises LinkError."""
        if self._is_closing():
            raise LinkError("the driver is closing")
        data = self._link.read(timeout_s)
        if not data:
            return []
        stamp_ns = self._now_ns()
        if self._tap is not None:
            self._tap.laser_bytes(stamp_ns, False, data)
        self.received_bytes += len(data)
        self.last_bytes = data
        messages = self._stream.feed(stamp_ns, data)
        self._pace(stamp_ns, len(data) + MESSAGE_BYTES * data.count(END))
        return messages

    def _pace(self, stamp_ns: int, size: int) -> None:
        """Wait until so much would have come at the fastest pace, as far as a burst is not free."""
        self._due_ns = min(max(self._due_ns, stamp_ns - BURST_NS) + NS_A_BYTE * size, stamp_ns + LONGEST_DEBT_NS)
        early_ns = self._due_ns - self._now_ns()
        if early_ns > 0:
            self._pause(min(early_ns, LONGEST_PAUSE_NS) * 1e-9)

    def drain(self, at_most_s: float) -> None:
        """Throw away what comes until it is quiet, or for so long. Raises LinkError."""
        until_ns = self._now_ns() + round(at_most_s * 1e9)
        while self._now_ns() < until_ns:
            before = self.received_bytes
            self.receive(QUIET_S)
            if self.received_bytes == before:
                break
        self._stream.reset()

    def ask(self, command: bytes, timeout_s: float) -> Message | None:
        """The reply to a command; None if it does not come or is damaged. Raises LinkError."""
        self.send(command)
        until_ns = self._now_ns() + round(timeout_s * 1e9)
        while True:
            remaining_ns = until_ns - self._now_ns()
            if remaining_ns <= 0:
                return None
            for raw in self.receive(remaining_ns * 1e-9):
                message = find_reply(raw.data, command)
                if message is not None:
                    return message


def find_reply(raw: bytes, command: bytes) -> Message | None:
    """The reply to a command at the end of a message, behind a torn message if there is one."""
    start = raw.rfind(command + LF)
    if start < 0:
        return None
    try:
        return parse_message(raw[start:])
    except ScipError:
        return None
