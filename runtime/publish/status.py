"""How running rovers are, asked over zenoh by someone who is not on board."""

import math
import re
import socket
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from typing import TYPE_CHECKING, Any

import zenoh

from runtime.publish.rover_status import believed
from runtime.publish.session import tool_session
from runtime.sensor_report import sensor_lines

if TYPE_CHECKING:
    from runtime.settings.configuration import Configuration

Status = dict[str, Any]

ENDPOINTS = tuple(f"tcp/127.0.0.1:{port}" for port in range(7447, 7453))
"""zenoh's own port, where a router would be, and the first five on which rovers of this machine listen."""

ASK_S = 1.0
LONGEST_HOST, LONGEST_NAME = 64, 32
MOST_ANSWERS = 1000  # at one endpoint
MOST_SHOWN = 40  # rovers, and answers that are none: anyone may answer under a thousand names
STATUS_KEY = "infant/*/status"
EVERY_ANSWER = zenoh.ConsolidationMode.NONE  # else one of two rovers of the same name would be left out


def fetch_status(
    connect: Sequence[str] = ENDPOINTS,
    timeout_s: float = ASK_S,
    config_file: str | None = None,
    refused: Callable[[str], None] = lambda _: None,
) -> list[Status]:
    """Status of every rover that answers in time at any of the endpoints, by name; none if nobody does.

    Two rovers of one name are both in it.

    config_file: a zenoh configuration with the certificates for a fleet's router. refused: told a sentence on each
    answer that is no rover's. Raises ConfigurationError when that file cannot be used.
    """
    found: dict[tuple[str, str], Status] = {}
    for endpoint in connect:
        with (
            suppress(zenoh.ZError),  # nobody listens there, which is how most of these endpoints are
            tool_session(endpoint, config_file) as session,
        ):
            for reply in islice(session.get(STATUS_KEY, timeout=timeout_s, consolidation=EVERY_ANSWER), MOST_ANSWERS):
                if reply.ok is None:
                    continue
                try:
                    status = believed(str(reply.ok.key_expr), reply.ok.payload.to_bytes())
                except ValueError as error:
                    refused(str(error))
                else:
                    found.setdefault((status["rover"], status["instance"]), status)
    return [found[key] for key in sorted(found)]


def watch_status(
    connect: Sequence[str] = ENDPOINTS,
    period_s: float = 1.0,
    config_file: str | None = None,
    refused: Callable[[str], None] = lambda _: None,
) -> Iterator[list[Status]]:
    """The same again and again, for ever: rovers may come and go."""
    while True:
        yield fetch_status(connect, period_s, config_file, refused)
        time.sleep(period_s)


def status_lines(statuses: Sequence[Status]) -> list[str]:
    """A line for each of so many rovers as are shown, and how many more there are."""
    return [*map(status_line, statuses[:MOST_SHOWN]), *_more(statuses)]


def ignored_lines(sentences: Sequence[str]) -> list[str]:
    """Why so many answers as are shown were ignored, and how many more were."""
    lines = [f"infant: an answer was ignored: {sentence}" for sentence in sentences[:MOST_SHOWN]]
    more = len(sentences) - len(lines)
    return [*lines, f"infant: {more} more answers were ignored"] if more else lines


def status_line(status: Mapping[str, Any]) -> str:
    """One rover in one line; before its first tick it has no pose."""
    words = [f"{status['rover']}  {status['state'] or status['quality']}"]
    if status["pose"] is not None:
        pose, sigma = status["pose"], status["sigma"]
        words.append(
            f"tick {status['seq']}  {status['rate_hz']:.1f} Hz  "
            f"x {pose['x_m']:.2f} m  y {pose['y_m']:.2f} m  heading {math.degrees(pose['heading_rad']):.1f} deg  "
            f"+-{math.hypot(sigma['x_m'], sigma['y_m']):.2f} m  landmarks {status['landmarks']}  "
            f"late {status['lateness_ms']:.2f} ms"
        )
    if status.get("map") is not None:
        words.append(map_words(status["map"]))
    return "  ".join((*words, *status["reasons"]))


def map_words(place: Mapping[str, Any]) -> str:
    """Which map, for how long, and the last recognition."""
    words = f"map {place['id']} for {place['for_s']:.0f} s"
    if place["recognised_s_ago"] is None:
        return words
    walls = "walls and " if place["by_scans"] else ""
    by = f"by {walls}{place['matches']} landmarks, odds {place['odds']:.0f}"
    return f"{words}, recognised {place['recognised_s_ago']:.0f} s ago {by}"


def status_table(statuses: Sequence[Mapping[str, Any]]) -> list[str]:
    """Several rovers as lines with a head, the columns as wide as what is in them; then their sensors, a line each, and
    how many more rovers there are than are shown.
    """
    statuses, more = statuses[:MOST_SHOWN], _more(statuses)
    head = (
        "rover",
        "host",
        "state",
        "tick",
        "Hz",
        "x m",
        "y m",
        "deg",
        "+- m",
        "landmarks",
        "late ms",
        "sensors",
        "reasons",
    )
    rows = [head, *(_row(status) for status in statuses)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(head))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    maps = [f"{status['rover']}  {map_words(status['map'])}" for status in statuses if status.get("map") is not None]
    sensors = [f"{status['rover']}  {line}" for status in statuses for line in sensor_lines(status["sensors"])]
    return [*lines, *maps, *sensors, *more]


def silence_sentence(connect: Sequence[str] = ENDPOINTS) -> str:
    """What to say when no rover answers."""
    where = ", ".join(connect)
    return f"no rover answers at {where}; start one with infant run, and check that publish.listen names one of these"


def _more(statuses: Sequence[Mapping[str, Any]]) -> list[str]:
    more = len(statuses) - MOST_SHOWN
    return [f"... and {more} more rovers; --json shows all"] if more > 0 else []


def _row(status: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        status["rover"],
        status.get("host") or "-",
        status["state"] or status["quality"],
        *_tick_cells(status),
        " ".join(f"{name}:{sensor['state']}" for name, sensor in status["sensors"].items()),
        "; ".join(status["reasons"]),
    )


def _tick_cells(status: Mapping[str, Any]) -> tuple[str, ...]:
    """From the number of the tick to its lateness."""
    pose, sigma = status["pose"], status["sigma"]
    if pose is None:
        return ("-",) * 8
    return (
        str(status["seq"]),
        f"{status['rate_hz']:.1f}",
        f"{pose['x_m']:.2f}",
        f"{pose['y_m']:.2f}",
        f"{math.degrees(pose['heading_rad']):.1f}",
        f"{math.hypot(sigma['x_m'], sigma['y_m']):.2f}",
        str(status["landmarks"]),
        f"{status['lateness_ms']:.2f}",
    )


def host_name() -> str:
    """Of this machine, as its status tells it."""
    return socket.gethostname()[:LONGEST_HOST]


def named(configuration: "Configuration") -> "Configuration":
    """With the name of this machine where the file gives the rover none; two rovers do not share a default."""
    if "rover" in configuration.model_fields_set:
        return configuration
    name = re.sub(r"[^A-Za-z0-9_-]", "-", host_name().split(".")[0])[:LONGEST_NAME]
    return configuration.model_copy(update={"rover": name}) if name else configuration


def namesake_trouble(rover: str, endpoints: Sequence[str], config_file: str | None) -> str:
    """Who else answers to this name at these endpoints, in one sentence, "" where nobody does.

    Asked before the rover itself answers; it waits as long as a tool would.
    """
    others = [status for status in fetch_status(endpoints, ASK_S, config_file) if status["rover"] == rover]
    if not others:
        return ""
    hosts = ", ".join(sorted({status["host"] or "a host that gives no name" for status in others}))
    return (
        f"another rover is called {rover}, on {hosts}: their messages are mixed up; give each its own name, rover = ..."
    )
