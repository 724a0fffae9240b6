"""Whoever asks over the wire learns how each rover is."""

import math
import socket
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drivers.measurements import SensorHealth, SensorState
from runtime.health import Health, PlaceInMap, RunState
from runtime.messages.map_json import json_bytes
from runtime.publish.messages import status_object
from runtime.publish.rover_status import believed
from runtime.publish.status import (
    MOST_SHOWN,
    fetch_status,
    ignored_lines,
    silence_sentence,
    status_line,
    status_lines,
    status_table,
    watch_status,
)
from runtime.tick import CompletedTick
from slam.estimate import Quality, Recognition
from tests.support.runtime.recorded_values import make_estimate, make_tick, make_timing
from tests.support.zenoh.wire import free_port, opened, publishing, put_ticks, settings_on, until

STALE = Health(
    0,
    RunState.DEGRADED,
    ("laser stale: no scan for 1.2 s",),
    {"laser": SensorHealth(SensorState.STALE, "no scan for 1.2 s", 0.0)},
    {},
    Quality.TRACKING,
)


def made_status(rover: str) -> dict[str, Any]:
    rng = np.random.default_rng(1)
    completed = CompletedTick(make_tick(3, rng), make_estimate(0, rng), make_timing(3), bytes(16), None)
    return status_object(rover, 7, completed, 10.0, STALE)


def test_two_rovers_are_both_found_and_do_not_mix() -> None:
    ports = free_port(), free_port()
    endpoints = [f"tcp/127.0.0.1:{port}" for port in ports]
    with publishing(settings_on(ports[0]), "b") as first, publishing(settings_on(ports[1]), "a") as second:
        assert opened(first)
        assert opened(second)
        first.note_health(STALE)
        put_ticks(first, range(30), 0.0)
        put_ticks(second, range(200, 220), 0.0)
        found: list[dict[str, Any]] = []

        def both() -> bool:
            found[:] = fetch_status(endpoints)
            return len(found) == 2

        assert until(both)
    assert [status["rover"] for status in found] == ["a", "b"]
    assert found[0]["seq"] >= 200 > found[1]["seq"]
    assert found[0]["state"] is None
    assert found[1]["sensors"]["laser"]["state"] == "stale"
    assert found[1]["listening"] == [endpoints[0]]


def test_the_rate_in_the_status_is_that_of_the_ticks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("runtime.publish.publisher.QUEUE", 100)
    port = free_port()
    with publishing(settings_on(port)) as publisher:
        assert opened(publisher)
        put_ticks(publisher, range(41), 0.0)

        found: list[dict[str, object]] = []

        def rate_known() -> bool:
            found[:] = fetch_status([f"tcp/127.0.0.1:{port}"])
            return bool(found) and found[0]["seq"] == 40

        assert until(rate_known)
        assert found[0]["rate_hz"] == 10.0


def test_nobody_there_is_an_empty_answer_in_bounded_time() -> None:
    port = free_port()
    assert fetch_status([f"tcp/127.0.0.1:{port}"], timeout_s=0.3) == []
    assert str(port) in silence_sentence([f"tcp/127.0.0.1:{port}"])


def test_who_accepts_and_says_nothing_is_not_waited_for_as_long_as_zenoh_would() -> None:
    """Ten seconds at each of six endpoints, while nobody says why."""
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        began_s = time.monotonic()
        assert fetch_status([f"tcp/127.0.0.1:{silent.getsockname()[1]}"]) == []
        assert time.monotonic() - began_s < 9.0


def test_watching_sees_a_rover_come_and_go() -> None:
    port = free_port()
    watch = watch_status([f"tcp/127.0.0.1:{port}"], period_s=0.05)
    assert next(watch) == []
    with publishing(settings_on(port)) as publisher:
        assert opened(publisher)
        put_ticks(publisher, range(5), 0.0)
        assert until(lambda: [status["rover"] for status in next(watch)] == ["r1"])
    assert until(lambda: next(watch) == [])


def test_a_line_holds_what_a_person_wants_to_know() -> None:
    status = made_status("r1")
    line = status_line(status)
    assert "r1  degraded  tick 3  10.0 Hz" in line
    assert f"heading {math.degrees(status['pose']['heading_rad']):.1f} deg" in line
    assert line.endswith("laser stale: no scan for 1.2 s")


def test_a_table_has_a_row_per_rover_and_even_columns() -> None:
    lines = status_table([made_status("r1"), made_status("a-long-name")])
    assert len({line.index("degraded") for line in lines[1:3]} | {lines[0].index("state")}) == 1
    assert lines[3:] == ["r1  laser     stale at 0.00 Hz", "a-long-name  laser     stale at 0.00 Hz"]


def test_however_many_names_are_forged_a_screen_of_them_is_shown_and_the_others_are_counted() -> None:
    one = made_status("r1")
    forged = [{**one, "rover": f"r{number:04d}"} for number in range(MOST_SHOWN + 960)]
    table, lines = status_table(forged), status_lines(forged)
    assert lines[-1] == table[-1] == "... and 960 more rovers; --json shows all"
    assert (len(table), len(lines)) == (1 + 2 * MOST_SHOWN + 1, MOST_SHOWN + 1)
    assert len(status_lines(forged[:MOST_SHOWN])) == MOST_SHOWN
    assert ignored_lines(["no status"] * 1000)[-1] == f"infant: {1000 - MOST_SHOWN} more answers were ignored"
    assert ignored_lines(["no status"]) == ["infant: an answer was ignored: no status"]


def test_a_status_names_the_map_and_the_last_recognition() -> None:
    found = Recognition(1, odds=16.4, mirror_odds=float("-inf"), matches=9)
    health = replace(STALE, stamp_ns=13_000_000_000, place=PlaceInMap(1, 3_000_000_000, 9_000_000_000, found))
    payload = json_bytes(status_object("rover1", 7, None, 10.0, health))
    status = believed("infant/rover1/status", payload)
    words = "map 1 for 10 s, recognised 4 s ago by 9 landmarks, odds 16"
    assert status_line(status).endswith(f"rover1  degraded  {words}  laser stale: no scan for 1.2 s")
    assert any(words in line for line in status_table([status]))
    by_walls = replace(health, place=PlaceInMap(1, 0, 9_000_000_000, replace(found, by_scans=True)))
    assert "by walls and 9 landmarks" in status_line(status_object("rover1", 7, None, 10.0, by_walls))
    unknown = replace(health, place=PlaceInMap(2, 3_000_000_000))
    assert "map 2 for 10 s  laser" in status_line(status_object("rover1", 7, None, 10.0, unknown))
