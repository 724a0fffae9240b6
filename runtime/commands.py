"""Commands to a running rover: each becomes an event of the next tick, and whoever obeys finds it there.

So a command is in the record for good, beside what it caused, and a replay sees it too.
"""

import queue
from collections.abc import Callable
from enum import StrEnum

from drivers.measurements import Event, Severity
from runtime.printable import printable

SOURCE = "command"
LONGEST_REASON = 1000
LONGEST_BYTES = 4 * LONGEST_REASON  # of as many characters in UTF-8
MOST_WAITING = 10  # commands that no tick has taken yet: more means that the loop stands


class Command(StrEnum):
    """What may be asked; the recorder obeys when it writes the tick that holds the event."""

    MARK = "mark"
    """Keep the segments around this moment; needs a reason."""
    SAVE = "save"
    """Close the segment at hand, so that everything until now is whole on disk, and write map.json."""
    STOP = "stop"
    """Write this tick and then no more; the rover drives on and publishes."""


def command_of(event: Event) -> Command | None:
    """The command that an event of a tick is, None for all other events."""
    return Command(event.kind) if event.source == SOURCE and event.kind in tuple(Command) else None


class CommandQueue:
    """Takes commands on any thread and hands events to the loop; neither ever waits for the other."""

    def __init__(self, now_ns: Callable[[], int]) -> None:
        self._now_ns = now_ns
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._stopped = False

    def drain_events(self) -> tuple[Event, ...]:
        """Commands since the last call, in the order of their arrival; the loop calls this."""
        return tuple(self._events.get() for _ in range(self._events.qsize()))

    def accept(self, command: Command, text: bytes) -> str:
        """Accept one command with its reason in UTF-8; returns why not, "" if it was accepted."""
        if len(text) > LONGEST_BYTES:
            return f"expected a reason of 1 to {LONGEST_REASON} characters, got {len(text)} bytes; say what was seen"
        reason = printable(text.decode("utf-8", errors="replace").strip(), LONGEST_BYTES)
        if self._stopped:
            return "the recording was stopped; only a new run records again"
        if len(reason) > LONGEST_REASON or (command is Command.MARK and not reason):
            return f"expected a reason of 1 to {LONGEST_REASON} characters, got {len(reason)}; say what was seen"
        if self._events.qsize() >= MOST_WAITING:
            return f"{MOST_WAITING} commands wait for the next tick; ask again later"
        self._stopped = command is Command.STOP
        severity = Severity.WARN if command is Command.STOP else Severity.INFO
        self._events.put(Event(self._now_ns(), SOURCE, command.value, reason or "no reason given", severity))
        return ""
