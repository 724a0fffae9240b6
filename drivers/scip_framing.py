"""Cuts the byte stream into messages: bounded in memory, in step again at the next pair of line feeds."""

from dataclasses import dataclass

from drivers.scip import END

MESSAGE_BYTES = 1 << 16  # a multi-echo scan with intensities of 1081 steps has about 20 kB


@dataclass(frozen=True, slots=True)
class RawMessage:
    """A message without its closing line feeds, and the time at which its first byte was read."""

    stamp_ns: int
    data: bytes


class MessageStream:
    """Collects what was read until a message is whole; never holds more than 64 kB."""

    def __init__(self) -> None:
        self._pending = b""
        self._stamp_ns = 0
        self._skipping = False
        self.discarded_bytes = 0

    @property
    def pending_bytes(self) -> int:
        """Bytes that wait for the rest of their message."""
        return len(self._pending)

    def reset(self) -> None:
        """Forget a message that has begun: the link is a new one."""
        self._pending, self._skipping = b"", False

    def feed(self, stamp_ns: int, data: bytes) -> list[RawMessage]:
        """Messages completed by `data`, which was read at stamp_ns."""
        messages: list[RawMessage] = []
        for start in range(0, len(data), MESSAGE_BYTES):
            self._take(stamp_ns, data[start : start + MESSAGE_BYTES], messages)
        return messages

    def _take(self, stamp_ns: int, data: bytes, messages: list[RawMessage]) -> None:
        first_ns = self._stamp_ns if self._pending else stamp_ns
        *complete, rest = (self._pending + data).split(END)
        for raw in complete:
            self._close(first_ns, raw, messages)
            first_ns = stamp_ns
        if len(rest) > MESSAGE_BYTES:
            self.discarded_bytes += len(rest) - 1
            rest, self._skipping = rest[-1:], True  # the last byte may be the first of the closing pair
        self._pending, self._stamp_ns = rest, first_ns

    def _close(self, first_ns: int, raw: bytes, messages: list[RawMessage]) -> None:
        raw = raw.lstrip(END)
        if self._skipping or len(raw) > MESSAGE_BYTES:
            self.discarded_bytes += len(raw)
            self._skipping = False
        elif raw:
            messages.append(RawMessage(first_ns, raw))
