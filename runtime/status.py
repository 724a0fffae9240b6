"""How running rovers are, asked over zenoh by someone who is not on board."""

import json
import math
import time
from collections.abc import Generator, Mapping, Sequence
from typing import Any

import zenoh

from runtime.zenoh_session import tool_config

Status = dict[str, Any]

ENDPOINTS = tuple(f"tcp/127.0.0.1:{port}" for port in range(7447, 7453))
"""zenoh's own port, where a router would be, and the first five on which rovers of this machine listen."""

ASK_S = 1.0
POLL_S = 0.05
STATUS_KEY = "infant/*/status"


def fetch_status(connect: Sequence[str] = ENDPOINTS, timeout_s: float = ASK_S) -> list[Status]:
    """Status of every rover that answers in time, by name; none if nobody does.

    Raises zenoh.ZError when an endpoint is not one.
    """
    with zenoh.open(tool_config(connect)) as session:
        found: dict[str, Status] = {}
        for reply in session.get(STATUS_KEY, timeout=timeout_s):
            if reply.ok is not None:
                status = json.loads(reply.ok.payload.to_bytes())
                found[status["rover"]] = status
        return [found[rover] for rover in sorted(found)]


def follow_status(connect: Sequence[str] = ENDPOINTS, silence_s: float = 3.0) -> Generator[Status | None, None, None]:
    """Each status as it is published; None whenever there was none for silence_s."""
    with zenoh.open(tool_config(connect)) as session:
        subscriber = session.declare_subscriber(STATUS_KEY, zenoh.handlers.FifoChannel(64))
        waited_s = 0.0
        while True:
            sample = _next_sample(subscriber)
            if sample is not None:
                waited_s = 0.0
                yield json.loads(sample.payload.to_bytes())
                continue
            waited_s += POLL_S
            if waited_s >= silence_s:
                waited_s = 0.0
                yield None


def _next_sample(subscriber: Any) -> Any:
    """The next sample, None after POLL_S; a blocking recv would not let Ctrl-C through."""
    sample = subscriber.try_recv()
    if sample is None:
        time.sleep(POLL_S)
    return sample


def status_line(status: Mapping[str, Any]) -> str:
    """One rover in one line."""
    pose, sigma = status["pose"], status["sigma"]
    spread_m = math.hypot(sigma["x_m"], sigma["y_m"])
    return (
        f"{status['rover']}  {status['state'] or status['quality']}  tick {status['seq']}  {status['rate_hz']:.1f} Hz  "
        f"x {pose['x_m']:.2f} m  y {pose['y_m']:.2f} m  heading {math.degrees(pose['heading_rad']):.1f} deg  "
        f"+-{spread_m:.2f} m  landmarks {status['landmarks']}  late {status['lateness_ms']:.2f} ms"
        + "".join(f"  {reason}" for reason in status["reasons"])
    )


def status_table(statuses: Sequence[Mapping[str, Any]]) -> list[str]:
    """Several rovers as lines with a head, the columns as wide as what is in them."""
    head = ("rover", "state", "tick", "Hz", "x m", "y m", "deg", "+- m", "landmarks", "late ms", "sensors", "reasons")
    rows = [head, *(_row(status) for status in statuses)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(head))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def silence_sentence(connect: Sequence[str] = ENDPOINTS) -> str:
    """What to say when no rover answers."""
    where = ", ".join(connect)
    return f"no rover answers at {where}; is infant run running, and does publish.listen name one of these?"


def _row(status: Mapping[str, Any]) -> tuple[str, ...]:
    pose, sigma = status["pose"], status["sigma"]
    return (
        status["rover"],
        status["state"] or status["quality"],
        str(status["seq"]),
        f"{status['rate_hz']:.1f}",
        f"{pose['x_m']:.2f}",
        f"{pose['y_m']:.2f}",
        f"{math.degrees(pose['heading_rad']):.1f}",
        f"{math.hypot(sigma['x_m'], sigma['y_m']):.2f}",
        str(status["landmarks"]),
        f"{status['lateness_ms']:.2f}",
        " ".join(f"{name}:{sensor['state']}" for name, sensor in status["sensors"].items()),
        "; ".join(status["reasons"]),
    )
