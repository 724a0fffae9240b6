"""Why the laser gave no scans, by what its driver said around that time."""

from collections.abc import Sequence

import numpy as np

from drivers.measurements import Event
from runtime.report.facts import RunFacts
from runtime.report.finding import Interval
from runtime.report.findings.silence import Advice, in_drivers_words

BEFORE_S, AFTER_S = 2.0, 1.5  # around a silence: what led to it, and what the driver found when it was over
SILENT_SHARE = 0.5  # of a laser's silence, without any wheel
BROKEN = ("broke", "closed the connection", "nothing listens", "no route", "unreachable")
POWER: Advice = ("the laser was switched off and on, or lost power", "check the laser's power supply and plug")
RESET: Advice = (
    "the laser's firmware reset its clock while it went on measuring: the connection stayed up",
    "update the laser's firmware; see laser.stamp_reference",
)
STANDS: Advice = ("the laser's clock has stopped", "switch the laser off and on, and update its firmware")
MALFUNCTION: Advice = (
    "the laser reported a malfunction that only a reboot clears",
    "have it serviced if it happens again",
)
LOST: Advice = (
    "messages are lost on the way: a loose plug, interference, or a network that is too busy",
    "connect the laser by its own cable, and check its plug",
)
LINK: Advice = ("the connection broke and was re-established", "check the laser's cable, plug and power; see laser.url")
HANGS: Advice = (
    "the laser stays connected but sends nothing: it hangs",
    "switch it off and on; update its firmware if it happens again",
)
HELD_UP: Advice = (
    "no wheel was heard at that time either: the host was too busy to read its sensors, or all of them lost power",
    "raise loop.priority so that other work on the host has to wait, or run less of it; check the common supply",
)
NOTHING: Advice = (
    "nothing arrives: the power or the cable failed, or the laser hangs",
    "check both, and that laser.url is right",
)
SAID = {  # kind of event, as far as it begins so: advice; the most telling first
    "malfunctions": MALFUNCTION,
    "status_": ("the laser reported an internal fault", "look up the status in its manual, then have it serviced"),
    "frozen_scans": (
        "the laser repeats the same ranges: its receiver or its motor is stuck",
        "switch it off and on",
    ),
    "stale_stamp": STANDS,
    "wrong_size": (
        "the laser answers a request that Infant did not send",
        "make sure that no other program talks to the laser",
    ),
    "checksum_errors": ("messages arrive damaged", "check the laser's cable and plug"),
    "not_scip": ("bytes arrive that are not SCIP messages", "check that laser.url names the laser, and its baud rate"),
    "framing_errors": ("messages arrive incomplete", "check the laser's cable and plug"),
    "torn_messages": ("messages arrive incomplete", "check the laser's cable and plug"),
    "garbage": (
        "scans arrive incomplete, although the laser answers questions correctly",
        "check the laser's cable and plug",
    ),
    "clock_restarts": POWER,
}


def around(facts: RunFacts, intervals: Sequence[Interval]) -> list[Event]:
    """What the laser's driver said shortly before, during and shortly after these times."""
    return [
        event
        for event in facts.events_of("laser")
        if any(start - BEFORE_S <= facts.seconds(event.stamp_ns) <= end + AFTER_S for start, end in intervals)
    ]


def silence_cause(facts: RunFacts, intervals: Sequence[Interval], events: Sequence[Event]) -> Advice:
    """Cause and remedy of silences, events: what was said around them."""
    for kind, advice in SAID.items():
        if any(event.kind.startswith(kind) for event in events):
            return advice
    if not facts.scans.times_s.size and (words := in_drivers_words(events, "link_errors")) is not None:
        return f"there never was a connection: {words[0]}", words[1] or LINK[1]
    if link_broke(events):
        return LINK
    if _all_were_silent(facts, intervals):
        return HELD_UP
    if any(_led_to(facts, event, start) for event in events for start, _ in intervals):
        return LOST
    return HANGS if any(event.kind in ("silences", "no_answer") for event in events) else NOTHING


def restart_cause(events: Sequence[Event]) -> Advice:
    """Cause and remedy of a clock that began anew, events: what was said around that time."""
    if any(event.kind == "stale_stamp" for event in events):
        return STANDS
    if any(event.kind == "malfunctions" for event in events):
        return MALFUNCTION
    return POWER if link_broke(events) else RESET


def link_broke(events: Sequence[Event]) -> bool:
    """Whether the connection itself ended."""
    return any(event.kind == "link_errors" and any(word in event.reason for word in BROKEN) for event in events)


def _led_to(facts: RunFacts, event: Event, start_s: float) -> bool:
    """Whether scans got lost one by one before all stayed away."""
    return event.kind == "dropped_scans" and start_s - BEFORE_S <= facts.seconds(event.stamp_ns) <= start_s + 0.2


def _all_were_silent(facts: RunFacts, intervals: Sequence[Interval]) -> bool:
    """Whether there was no good sample of the wheels for most of each of these times."""
    wheels_s = facts.wheels.times_s[facts.wheels.valid]
    if not wheels_s.size:
        return False
    for start, end in intervals:
        inside_s = wheels_s[(wheels_s > start) & (wheels_s < end)]
        longest_s = float(np.diff(np.concatenate(((start,), inside_s, (end,)))).max())
        if longest_s < SILENT_SHARE * (end - start):
            return False
    return True
