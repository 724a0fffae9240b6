"""Commands to a running rover: each becomes an event of the next tick, and whoever obeys finds it there.

So a command is in the record for good, beside what it caused, and a replay sees it too.
"""

import math
import queue
from collections.abc import Callable
from enum import StrEnum

from drivers.measurements import Event, Severity
from runtime.printable import printable
from slam.pose import Pose2
from slam.recognise.prior import LARGEST_SIGMA_M, PosePrior

SOURCE = "command"
LONGEST_REASON = 1000
LONGEST_BYTES = 4 * LONGEST_REASON  # of as many characters in UTF-8
MOST_WAITING = 10  # commands that no tick has taken yet: more means that the loop stands


class Command(StrEnum):
    """What may be asked; the recorder obeys when it writes the tick that holds the event."""

    MARK = "mark"
    """Keep the segments around this moment; needs a reason."""
    SAVE = "save"
    """Close the current segment, so that everything until now is safely on disk, and write map.json."""
    STOP = "stop"
    """Record this tick and nothing after it; the rover drives on and publishes."""
    INITIAL_POSE = "initial_pose"
    """Search the map around this pose, and move there if the surroundings agree."""


FARTHEST_M = 1e7
TOLD_SIGMA_M, TOLD_SIGMA_RAD = 0.5, 0.26  # of a pose that is clicked into a map, as RViz gives it
POSE_WORDS = "expected X,Y,YAW or X,Y,YAW,SIGMA_M,SIGMA_RAD in metres and radians, for example 3.5,-2,1.57,0.5,0.26"


def command_of(event: Event) -> Command | None:
    """The command that an event of a tick is, None for all other events."""
    return Command(event.kind) if event.source == SOURCE and event.kind in tuple(Command) else None


def parse_prior(text: str) -> PosePrior:
    """X,Y,YAW[,SIGMA_M,SIGMA_RAD]: map_from_body and its standard deviations. Raises ValueError with a sentence."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (3, 5) or not all(math.isfinite(number) for number in numbers):
        raise ValueError(f"{printable(text, 80) or 'an empty pose'}: {POSE_WORDS}")
    x_m, y_m, yaw_rad, sigma_m, sigma_rad = (*numbers, TOLD_SIGMA_M, TOLD_SIGMA_RAD)[:5]
    if max(abs(x_m), abs(y_m), abs(yaw_rad)) > FARTHEST_M:
        raise ValueError(f"{text}: expected X, Y and YAW within {FARTHEST_M:g}; give metres and radians of the map")
    if not (0.0 < sigma_m <= LARGEST_SIGMA_M and 0.0 < sigma_rad <= math.pi):
        raise ValueError(
            f"{text}: expected SIGMA_M above 0 and at most {LARGEST_SIGMA_M:g}, SIGMA_RAD above 0 and at "
            f"most {math.pi:.2f}; if less is known, give no pose"
        )
    return PosePrior(Pose2() @ Pose2(x_m, y_m, yaw_rad), sigma_m, sigma_rad)


def told_pose(events: tuple[Event, ...]) -> PosePrior | None:
    """Where the events of a tick say that the rover is: the last one counts, and one that makes no sense does not."""
    for event in reversed(events):
        if command_of(event) is Command.INITIAL_POSE:
            try:
                return parse_prior(event.reason)
            except ValueError:
                continue
    return None


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
            return f"expected a reason of 1 to {LONGEST_REASON} characters, got {len(text)} bytes; say what you saw"
        reason = printable(text.decode("utf-8", errors="replace").strip(), LONGEST_BYTES)
        if command is Command.INITIAL_POSE:
            try:
                parse_prior(reason)
            except ValueError as error:
                return str(error)
        elif self._stopped:
            return "the recording was stopped; only a new run records again"
        if len(reason) > LONGEST_REASON or (command is Command.MARK and not reason):
            return f"expected a reason of 1 to {LONGEST_REASON} characters, got {len(reason)}; say what you saw"
        if self._events.qsize() >= MOST_WAITING:
            return f"{MOST_WAITING} commands are waiting for the next tick; try again later"
        self._stopped = self._stopped or command is Command.STOP
        severity = Severity.WARN if command is Command.STOP else Severity.INFO
        self._events.put(Event(self._now_ns(), SOURCE, command.value, reason or "no reason given", severity))
        return ""
