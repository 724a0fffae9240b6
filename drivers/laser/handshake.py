"""From an open link to a known laser: quiet, SCIP 2.0, and its own description. Section by section as the
specification's start-up wants it; every step may find a stream that still runs or a command left half."""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.laser.client import QUIET_S, ScipClient
from drivers.measurements import DeviceError, LinkError, ProtocolError
from drivers.scip.codec import OK, ScipError, StatusError, is_fault, parse_key_values
from drivers.scip.model import Parameters, is_booting, parse_parameters, reports_fault
from drivers.settings.laser import LaserSettings

REPLY_TIMEOUT_S = 0.5  # s until a command counts as not answered
ATTEMPTS, OPTIONAL_ATTEMPTS = 3, 2
DRAIN_S = 0.4
BOOT_NS = 15_000_000_000  # real ones boot in 2 s


class NoAnswerError(LinkError):
    """The link is open, but nothing on it answers."""


class NotScipError(ProtocolError):
    """Something answers that is no SCIP device, or at another baud rate."""


class LaserFaultError(DeviceError):
    """The laser reports a malfunction of its own."""


@dataclass(frozen=True, slots=True)
class Device:
    """What a laser says of itself; version and state hold the lines of VV and II, where it answers them."""

    parameters: Parameters
    version: dict[str, str]
    state: dict[str, str]

    @property
    def complaint(self) -> str:
        """What it says of itself that may be a malfunction; "" where it is well. Only whether it measures decides."""
        return self.state["STAT"] if reports_fault(self.state.get("STAT", "")) else ""


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
        reply = client.ask(b"PP", REPLY_TIMEOUT_S)
        if reply is not None and reply.status == OK:
            return  # it sends nothing, so there is nothing to stop, and does not answer QT
        raise NoAnswerError(
            f"{settings.url} is open but silent; check that it is the laser, and its power and baud rate"
        )
    first = client.last_bytes[:16]
    raise NotScipError(f"{settings.url} answers with {first!r}, which is not SCIP; check port and baud rate")


class BootWait:
    """A laser that says that it boots is waited for, but not for ever: some say so for as long as they run."""

    def __init__(self, now_ns: Callable[[], int]) -> None:
        self._now_ns = now_ns
        self._since_ns: int | None = None

    def check(self, state: dict[str, str]) -> None:
        """Raises DeviceError while it is worth waiting. state: the lines of II."""
        if not is_booting(state.get("MESM", "")):
            self._since_ns = None
            return
        self._since_ns = self._now_ns() if self._since_ns is None else self._since_ns
        if self._now_ns() - self._since_ns <= BOOT_NS:
            raise DeviceError("the laser is still booting; waiting for it")


def describe(client: ScipClient, settings: LaserSettings, boot: BootWait) -> Device:
    """Ask a quiet laser for VV, PP and II.

    Only PP is needed. Raises ProtocolError for parameters that cannot be used, DeviceError of
    a laser that boots.
    """
    parameters = parse_parameters(_key_values(client, b"PP", settings))
    version = _optional(client, b"VV")
    state = _optional(client, b"II")
    boot.check(state)
    return Device(parameters, version, state)


def _key_values(client: ScipClient, command: bytes, settings: LaserSettings) -> dict[str, str]:
    before = None
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
            if reply == before:  # noise is never twice the same: this firmware says it so
                return parse_key_values(reply, is_lenient=True)
            before = reply
    raise NoAnswerError(f"{settings.url} does not answer {command.decode()} readably; check its cable and power")


def _optional(client: ScipClient, command: bytes) -> dict[str, str]:
    """What is only told to people: whatever can be read of it."""
    for _ in range(OPTIONAL_ATTEMPTS):
        reply = client.ask(command, REPLY_TIMEOUT_S)
        if reply is not None:
            return parse_key_values(reply, is_lenient=True) if reply.status == OK else {}
    client.drain(QUIET_S)
    return {}
