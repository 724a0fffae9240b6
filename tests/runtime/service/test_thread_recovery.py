"""How soon each thread of a live run works again after an exception out of nowhere; the figures are printed."""

import io
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from drivers.measurements import SensorState
from runtime.publish.session import tool_config
from tests.support.drivers.raising import raise_in
from tests.support.runtime.live_laser import LiveRun, live_run
from tests.support.zenoh.wire import free_port, until

TIMES = 20
RECOVERY_S = 2.0


class Terminal(io.StringIO):
    """On which the status line is written twice a second."""

    def isatty(self) -> bool:
        return True


def told_count(trouble: str) -> int:
    """How often a thread failed, by what its part says of it."""
    return int(trouble.partition("restarted (")[2].partition(" ")[0] or 0)


@pytest.mark.bench
@pytest.mark.timeout(3600)
def test_every_thread_works_again_within_two_seconds_and_says_what_it_was(tmp_path: Path) -> None:
    port, terminal = free_port(), Terminal()
    overrides = {"publish.enabled": "true", "publish.listen": f"['tcp/127.0.0.1:{port}']", "publish.connect": "[]"}
    with live_run(tmp_path / "run", overrides, terminal) as run:
        session = zenoh.open(tool_config(f"tcp/127.0.0.1:{port}"))

        def published() -> int:
            """Tick in the status, -1 where nobody answers."""
            for reply in session.get("infant/faulty/status", timeout=0.2):
                if reply.ok is not None:
                    return int(json.loads(reply.ok.payload.to_bytes())["seq"])
            return -1

        # thread: a figure that grows while it works, and how often it told of a failure (None: it only logs it)
        threads: dict[str, tuple[Callable[[], int], Callable[[], int] | None]] = {
            "laser": (lambda: run.count("scans"), lambda: run.count("defects")),
            "encoders": (lambda: fresh_sessions(run), lambda: wheel_count(run, "bus.defects")),
            "recorder": (lambda: size(run), lambda: told_count(run.parts.recorder.health().trouble)),
            "publish": (published, lambda: told_count(run.parts.publisher.health().trouble)),
            "status-line": (lambda: len(terminal.getvalue()), None),
        }
        slowest_s = {name: max(recoveries(name, *asked)) for name, asked in threads.items()}
        session.close()  # type: ignore[no-untyped-call]
    sys.stdout.write(f"\n{json.dumps({'slowest_s': slowest_s})}\n")
    assert max(slowest_s.values()) < RECOVERY_S


def recoveries(name: str, figure: Callable[[], int], failures: Callable[[], int] | None) -> list[float]:
    """Seconds from the exception until the thread works again, for each time; asserts that it was counted."""
    took_s = []
    for _ in range(TIMES):
        before = figure()
        assert until(lambda before=before: figure() > before)  # type: ignore[misc]
        counted, began_s = failures() if failures else 0, time.monotonic()
        raise_in(name)
        if failures:
            assert until(lambda counted=counted: failures() > counted)  # type: ignore[misc]
        at = figure()
        assert until(lambda at=at: figure() > at)  # type: ignore[misc]
        took_s.append(time.monotonic() - began_s)
    row = {"thread": name, "times": TIMES, "median_s": float(np.median(took_s)), "slowest_s": max(took_s)}
    sys.stdout.write(f"\n{json.dumps(row)}")
    return took_s


def wheel_count(run: LiveRun, counter: str) -> int:
    return run.parts.encoders.health().counters.get(counter, 0)


def fresh_sessions(run: LiveRun) -> int:
    """Grows with the time at which both wheels were heard last."""
    health: Any = run.parts.encoders.health()
    heard_s = time.monotonic() - health.figures.get("left_age_s", 1e9)
    return round(heard_s * 1e3) if health.state is SensorState.FRESH else -1


def size(run: LiveRun) -> int:
    return sum(path.stat().st_size for path in run.folder.segment_paths())
