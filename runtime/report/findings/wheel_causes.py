"""Why a wheel gave no counts, by what the driver said around that time."""

import re
from collections.abc import Collection, Sequence

from drivers.measurements import Event
from runtime.report.facts import RunFacts
from runtime.report.finding import Interval
from runtime.report.findings.silence import Advice, in_drivers_words

LAYOUT = "the layout of the frames differs from the configured one"
DAMAGE = {
    "crc": "frames arrive damaged, or another node sends under this id",
    "length": f"frames have the wrong length: {LAYOUT}",
    "standard": f"frames have 11-bit ids where 29 bits are expected: {LAYOUT}",
    "extended": f"frames have 29-bit ids where 11 bits are expected: {LAYOUT}",
    "fd": "CAN FD frames arrive where classic ones are expected",
    "remote": "another node requests frames under this id",
    "two_senders": "two nodes send under one id",
    "too_soon": "two nodes send under one id",
    "alive_frozen": "the program of the node hangs",
    "status": "the node itself reports that its counts are not valid",
    "speed_disagrees": "the encoder, its coupling or its magnet slips",
    "lost_together": "the reader was held up, or the bus was interrupted",
}
BUS = {  # kind of event: cause; the gravest first
    "bus_off": "the CAN controller went off the bus after too many errors: wiring, termination or bit rate",
    "passive": "the CAN controller is error-passive: wiring, termination or bit rate of the bus",
    "warning": "the CAN controller is at its error-warning limit: wiring or termination of the bus",
    "bitrate": "the CAN bus carries only errors: the bit rate differs from the configured one, or the wiring is broken",
    "restarted": "the CAN bus was interrupted: wiring or termination",
}
GONE = ("open", "read")  # kinds of event: the bus itself cannot be opened or read
DEAD_BUS: Advice = (
    "both nodes lost power, or the bus is broken",
    "check power and cables of both nodes and the bus; see [encoders.bus]",
)
NEVER_HEARD: Advice = (
    "no frame with a configured id was ever heard: the nodes have no power, the bus is not connected or runs at "
    "another bit rate, or the wheels use other ids",
    "check power and cables, [encoders.bus] and [encoders.layout]; infant check --config FILE --live says which ids "
    "are heard",
)
FLOOD: Advice = (
    "other frames flooded the bus, or the host was too busy to read them: they waited in the buffer",
    "find the node that sends so much, and raise loop.priority so that other work on the host has to wait",
)
BEFORE_S, AFTER_S = 0.5, 0.5
EDGE_S = 0.1  # of a silence: what waits there may be the last frames before it or the first ones after it
BACK_S = 2.0  # a node tells of its restart once a second


def around(facts: RunFacts, intervals: Sequence[Interval], after_s: float = AFTER_S) -> list[Event]:
    """What the encoders' driver said around these times."""
    return [
        event
        for event in facts.events_of("encoders")
        if any(start - BEFORE_S <= facts.seconds(event.stamp_ns) <= end + after_s for start, end in intervals)
    ]


def frames_waited(facts: RunFacts, intervals: Sequence[Interval]) -> bool:
    """Whether frames were in the buffer for long in the middle of these times, in which no wheel's were among them."""
    waited_s = [facts.seconds(event.stamp_ns) for event in facts.events_of("encoders", "late", "overflow")]
    return any(start + EDGE_S < time_s < end - EDGE_S for time_s in waited_s for start, end in intervals)


def side_of(event: Event) -> str:
    """Left or right; "" for an event of the bus."""
    found = re.match(r"(left|right) wheel", event.reason)
    return found.group(1) if found else ""


def wheels_text(sides: Collection[str]) -> str:
    """The left wheel, the right wheel, both wheels."""
    return f"the {next(iter(sides))} wheel" if len(sides) == 1 else "both wheels"


def encoders_text(sides: Collection[str]) -> str:
    """The left wheel encoder, or both."""
    return f"The {next(iter(sides))} wheel encoder" if len(sides) == 1 else "Both wheel encoders"


def dead_bus(events: Sequence[Event], never: bool) -> Advice:
    """Cause and remedy where nothing at all came from the bus; never: in the whole run."""
    if (words := in_drivers_words(events, *GONE)) is not None:
        return words[0], words[1] or DEAD_BUS[1]
    return NEVER_HEARD if never else DEAD_BUS


def silence_cause(
    events: Sequence[Event], faults: Sequence[Event], sides: Collection[str], waited: bool, never: bool
) -> Advice:
    """Cause and remedy of counts that stayed away. faults: those of the events that say that a wheel could not be
    used; waited: whether other frames waited meanwhile until they were read; never: no count came in the whole run.
    """
    one = len(sides) == 1
    remedy = "check its power and its cable" if one else FLOOD[1] if waited else DEAD_BUS[1]
    if (cause := _told_cause(events, faults)) is not None:
        return cause, remedy
    if waited and not one:
        return FLOOD
    return ("this node lost power, or its cable came loose", remedy) if one else dead_bus(events, never)


def _told_cause(events: Sequence[Event], faults: Sequence[Event]) -> str | None:
    """What the driver said of the bus, of frames that came, or of a node that restarted."""
    for kind, cause in BUS.items():
        if any(event.kind == kind for event in events):
            return cause
    if any("counts_per_rev" in event.reason for event in faults):
        return "its counts are rejected because the configuration describes another node"
    for event in faults:
        if event.kind in DAMAGE and event.kind != "lost_together":
            return DAMAGE[event.kind]
    if any(event.kind == "restart" for event in events):
        return "the node lost power and restarted when power came back"
    return None
