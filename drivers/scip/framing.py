"""Cuts the byte stream into messages: bounded in memory, in step again at the next pair of line feeds."""

import re
from dataclasses import dataclass

from drivers.scip.codec import END

CR = b"\r"
ENDS = re.compile(rb"\n\n+")  # line feeds alone would be a message of nothing each
MESSAGE_BYTES = 1 << 16  # a multi-echo scan with intensities of 1081 steps has about 20 kB


@dataclass(frozen=True, slots=True)
class RawMessage:
    """A message without its closing line feeds, and the time at which its first byte was read."""

    stamp_ns: int
    data: bytes


class MessageStream:
    """Collects what was read until a message is whole; never holds more than 64 kB, and looks at each byte once."""

    def __init__(self) -> None:
        self._pending = bytearray()
        self._stamp_ns = 0
        self._skipping = False
        self.discarded_bytes = 0

    @property
    def pending_bytes(self) -> int:
        """Bytes that wait for the rest of their message."""
        return len(self._pending)

    def reset(self) -> None:
        """Forget a message that has begun: the link is a new one."""
        self._pending.clear()
        self._skipping = False

    def feed(self, stamp_ns: int, data: bytes) -> list[RawMessage]:
        """Messages completed by `data`, which was read at stamp_ns."""
        messages: list[RawMessage] = []
        data = data.replace(CR, b"")  # a terminal or a serial server puts it before each line feed; nothing else has it
        for start in range(0, len(data), MESSAGE_BYTES):
            self._take(stamp_ns, data[start : start + MESSAGE_BYTES], messages)
        return messages

    def _take(self, stamp_ns: int, data: bytes, messages: list[RawMessage]) -> None:
        pending = self._pending
        if not pending:
            self._stamp_ns = stamp_ns
        searched = max(0, len(pending) - 1)  # the pair may be cut between two reads
        pending += data
        begin, whole = 0, bytes(pending)
        for end in ENDS.finditer(whole, searched):
            self._close(whole[begin : end.start()], messages)
            self._stamp_ns = stamp_ns
            begin = end.end()
        del pending[:begin]
        if len(pending) > MESSAGE_BYTES:
            self.discarded_bytes += len(pending) - 1
            del pending[:-1]  # the last byte may be the first of the closing pair
            self._skipping = True

    def _close(self, raw: bytes, messages: list[RawMessage]) -> None:
        raw = raw.lstrip(END)
        if self._skipping or len(raw) > MESSAGE_BYTES:
            self.discarded_bytes += len(raw)
            self._skipping = False
        elif raw:
            messages.append(RawMessage(self._stamp_ns, raw))
