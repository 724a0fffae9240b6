"""Which rover a tool means that follows one: the only one that answers, or the one that is named."""

from collections.abc import Sequence
from dataclasses import dataclass

from runtime.errors import SensorError, UsageError
from runtime.publish.rover_status import ROVER
from runtime.publish.status import ENDPOINTS, fetch_status, silence_sentence

DEFAULT_PORT = 7448


@dataclass(frozen=True, slots=True)
class FoundRover:
    """A rover and the endpoint at which it answers."""

    name: str
    endpoint: str


def find_rover(connect: str | None, rover: str | None, config_file: str | None = None) -> FoundRover:
    """Ask at `connect`, an endpoint or a host; None: wherever rovers of this machine listen.

    rover: its name; None: the only one. Raises SensorError where none answers, UsageError where several do or no rover
    can have this name, ConfigurationError where config_file cannot be used.
    """
    if rover is not None and not ROVER.fullmatch(rover):
        raise UsageError(f"--rover {rover!r}: expected a name of 1 to 32 letters, digits, - and _")
    endpoints = ENDPOINTS if connect is None else (endpoint_of(connect),)
    found: dict[str, str] = {}
    for endpoint in endpoints:
        for status in fetch_status((endpoint,), config_file=config_file):
            found.setdefault(status["rover"], endpoint)
        if rover in found:
            break
    if rover is not None and rover not in found:
        others = f"; {', '.join(sorted(found))} answers there" if found else ""
        raise SensorError(
            f"{rover} does not answer at {_where(endpoints)}; start it with infant run, or give --connect{others}"
        )
    if not found:
        raise SensorError(silence_sentence(endpoints))
    if rover is None and len(found) > 1:
        raise UsageError(f"several rovers answer: {', '.join(sorted(found))}; name one with --rover")
    name = rover or next(iter(found))
    return FoundRover(name, found[name])


def endpoint_of(connect: str) -> str:
    """A zenoh endpoint as it is; a host, with or without a port, as one over TCP."""
    if "/" in connect:
        return connect
    host, _, port = connect.rpartition(":")
    return f"tcp/{connect}" if host and port.isdigit() else f"tcp/{connect}:{DEFAULT_PORT}"


def _where(endpoints: Sequence[str]) -> str:
    return ", ".join(endpoints)
