"""From an open link to a known laser: quiet, SCIP 2.0, and its own description. Section by section as the
specification's start-up wants it; every step may find a stream that still runs or a command left half."""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.laser.client import QUIET_S, ScipClient
from drivers.measurements import DeviceError, LinkError, ProtocolError
from drivers.scip.codec import OK, ScipError, StatusError, is_fault, parse_key_values, parse_time
from drivers.scip.model import Parameters, is_booting, parse_parameters, reports_fault
from drivers.settings.laser import LaserSettings

REPLY_TIMEOUT_S = 0.5  # s until a command counts as not answered
TIME_SYNC_SAMPLES = 50  # TM1 requests; all brackets together count, and 50 take 30 ms on a network
ATTEMPTS = 3
DRAIN_S = 0.4
TIME_SYNC_S = 1.0  # UST firmware answers TM slowly; a start must not hang on it


class NoAnswerError(LinkError):
    """The link is open, but nothing on it answers."""


class NotScipError(ProtocolError):
    """Something answers that is no SCIP device, or at another baud rate."""


class LaserFaultError(DeviceError):
    """The laser reports a malfunction of its own."""


@dataclass(frozen=True, slots=True)
class Device:
    """What a laser says of itself; version and state hold the lines of VV and II."""

    parameters: Parameters
    version: dict[str, str]
    state: dict[str, str]


def enter_standby(client: ScipClient, settings: LaserSettings, attempts: int, drain_first: bool = True) -> None:
    """Bring the laser to standby in SCIP 2.0, whatever it was doing.

    drain_first: wait until the line is quiet; not needed where the conversation has been in step before.

    Raises NoAnswerError, NotScipError, LaserFaultError, LinkError.
    """
    before = client.received_bytes
    for attempt in range(attempts):
        client.send(b"")  # ends a command that was left half
        if drain_first or attempt:
            client.drain(DRAIN_S)
        reply = client.ask(b"QT", REPLY_TIMEOUT_S)
        if reply is None:
            continue
        if reply.legacy:
            client.ask(b"SCIP2.0", REPLY_TIMEOUT_S)
            reply = client.ask(b"QT", REPLY_TIMEOUT_S)
        elif reply.status in ("0E", "10"):
            client.ask(b"TM2", REPLY_TIMEOUT_S)  # it may be in its time adjustment, where QT is refused
            reply = client.ask(b"QT", REPLY_TIMEOUT_S)
        if reply is not None and reply.status == OK:
            return
        if reply is not None and is_fault(reply.status):
            raise LaserFaultError(f"the laser reports a malfunction (status {reply.status}); it needs a reboot")
    if client.received_bytes == before:
        raise NoAnswerError(f"{settings.url} is open but silent; check that it is the laser, its power and baud rate")
    first = client.last_bytes[:16]
    raise NotScipError(f"{settings.url} answers with {first!r}, which is not SCIP; check port and baud rate")


def describe(client: ScipClient, settings: LaserSettings) -> Device:
    """Ask a quiet laser for VV, PP and II.

    Raises ProtocolError for a description that cannot be used, DeviceError for a laser that is not well or not ready.
    """
    parameters = parse_parameters(_key_values(client, b"PP", settings))
    version = _optional(client, b"VV", settings)
    state = _optional(client, b"II", settings)
    if is_booting(state.get("MESM", "")):
        raise DeviceError("the laser is still booting; waiting for it")
    if reports_fault(state.get("STAT", "")):
        raise LaserFaultError(f"the laser reports {state['STAT']!r}; it needs a reboot")
    return Device(parameters, version, state)


def adjust_time(client: ScipClient, now_ns: Callable[[], int]) -> list[tuple[int, int, int]]:
    """Answers to TM1 as (host ns before, host ns after, counter ms); empty where the laser has no such mode."""
    reply = client.ask(b"TM0", REPLY_TIMEOUT_S)
    answers: list[tuple[int, int, int]] = []
    if reply is not None and reply.status in (OK, "02"):
        until_ns = now_ns() + round(TIME_SYNC_S * 1e9)
        for _ in range(TIME_SYNC_SAMPLES):
            before_ns = now_ns()
            reply = client.ask(b"TM1", REPLY_TIMEOUT_S)
            after_ns = now_ns()
            if reply is None or reply.status != OK or not reply.lines or after_ns > until_ns:
                break
            try:
                answers.append((before_ns, after_ns, parse_time(reply.lines[0])))
            except ScipError:
                continue  # one damaged answer of many
    client.ask(b"TM2", REPLY_TIMEOUT_S)
    return answers


def _key_values(client: ScipClient, command: bytes, settings: LaserSettings) -> dict[str, str]:
    for _ in range(ATTEMPTS):
        reply = client.ask(command, REPLY_TIMEOUT_S)
        if reply is None:
            client.drain(QUIET_S)
            continue
        if reply.status != OK:
            raise StatusError(command.decode(), reply.status)
        try:
            return parse_key_values(reply)
        except ScipError:
            continue  # damaged on the way; asked again
    raise NoAnswerError(f"{settings.url} does not answer {command.decode()} in a form that can be read")


def _optional(client: ScipClient, command: bytes, settings: LaserSettings) -> dict[str, str]:
    try:
        return _key_values(client, command, settings)
    except StatusError:
        return {}
