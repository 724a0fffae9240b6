"""What faults do to the messages of a simulated laser on their way to the client."""

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from drivers.settings.simulated_laser import FaultKind, LaserFault
from drivers.simulated.laser.ports import Wire
from drivers.simulated.laser.protocol import LaserProtocol, Sweep

Faults = dict[FaultKind, LaserFault]
NOISE_BYTES = 16


@dataclass(frozen=True, slots=True, eq=False)
class DelayedMessage:
    """Bytes that leave at a time."""

    due_ns: int
    wire: Wire
    data: bytes


class FaultInjector:
    """Sends messages, whole or not; keeps what a fault has to remember."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._delayed: deque[DelayedMessage] = deque()
        self._stuck: Sweep | None = None
        self._stale: Sweep | None = None

    @property
    def next_ns(self) -> int | None:
        """When the next delayed message leaves."""
        return self._delayed[0].due_ns if self._delayed else None

    def deliver(self, now_ns: int) -> None:
        """Send what is due."""
        while self._delayed and self._delayed[0].due_ns <= now_ns:
            message = self._delayed.popleft()
            message.wire.send(message.data)

    def forget(self, wire: Wire) -> None:
        """Nothing more goes to this client."""
        self._delayed = deque(message for message in self._delayed if message.wire is not wire)

    def sweep(self, sweep: Sweep, faults: Faults) -> Sweep:
        """The sweep with ranges or stamp of an earlier one."""
        self._stuck = (self._stuck or sweep) if FaultKind.STUCK in faults else None
        self._stale = (self._stale or sweep) if FaultKind.STALE_STAMP in faults else None
        if self._stuck is not None:
            sweep = replace(sweep, codes=self._stuck.codes)
        if self._stale is not None:
            sweep = replace(sweep, counter_ms=self._stale.counter_ms)
        return sweep

    def send_scan(self, wire: Wire, protocol: LaserProtocol, sweep: Sweep, faults: Faults, now_ns: int) -> None:
        """The stream's next message."""
        status = faults.get(FaultKind.STATUS)
        if status is not None:
            self.send(wire, protocol.status_in_stream(status.status), faults, now_ns)
            return
        message = protocol.scan(sweep, missing_steps=1 if FaultKind.WRONG in faults else 0)
        middle = len(message) // 2
        if FaultKind.BAD_CHECKSUM in faults:
            # the lowest bit of a character of data: still a legal character
            while message[middle] < 0x30:
                middle += 1
            message = b"%s%c%s" % (message[:middle], message[middle] ^ 1, message[middle + 1 :])
        if FaultKind.HALF_MESSAGE in faults:
            message = message[:middle]
        self.send(wire, message, faults, now_ns)

    def send(self, wire: Wire, data: bytes, faults: Faults, now_ns: int) -> None:
        """Any message."""
        if FaultKind.SILENCE in faults:
            return
        intermittent = faults.get(FaultKind.INTERMITTENT)
        if intermittent is not None and self._rng.random() < intermittent.loss:
            return
        if FaultKind.GARBAGE in faults:
            data = self._rng.bytes(len(data))
        delayed = faults.get(FaultKind.DELAYED)
        if delayed is None and not self._delayed:
            wire.send(data)
            return
        # a message never overtakes another
        due_ns = now_ns + (round(delayed.delay_s * 1e9) if delayed is not None else 0)
        self._delayed.append(DelayedMessage(max(due_ns, self._delayed[-1].due_ns if self._delayed else 0), wire, data))

    def send_noise(self, wire: Wire) -> None:
        """What a serial line at the wrong rate turns a reply into."""
        wire.send(self._rng.bytes(NOISE_BYTES))
