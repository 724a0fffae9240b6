"""The service under the limit of memory of its unit, while peers ask and put more than fits into it.

`make soak` runs it with -s for the figures: the kernel's own memory limit, a simulated rover beside it.
"""

import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime.publish.access import LARGEST_MESSAGE
from runtime.publish.status import fetch_status
from runtime.record.reader import RunReader
from runtime.source_tree import ROOT
from runtime.studies.soak.process_sampler import OTHERS_S, kept_waiting_s
from tests.support.runtime.measured import VEHICLE
from tests.support.runtime.memory_group import MemoryGroup, memory_group
from tests.support.zenoh.fleet import Fleet, running_fleet
from tests.support.zenoh.wire import free_port, until

UNIT = (ROOT / "systemd" / "infant.service").read_text()
LIMIT_BYTES = int(re.findall(r"^MemoryMax=(\d+)M$", UNIT, re.MULTILINE)[0]) << 20
GROWTH_MB = 50.0
FLOODERS, FLOOD_S = 3, 60.0
PERIOD_NS = 100_000_000
SETTLED_S = 20.0  # of driving, after which memory grows with the map alone
ROVER = (
    """
rover = "rover1"
[laser]
url = "tcp://127.0.0.1:{laser}"
[encoders.bus]
interface = "udp_multicast"
channel = "239.74.163.7"
port = {bus}
[slam.mount]
x_m = 0.3
"""
    + VEHICLE
)
WAYS = ("directly", "through the router of the fleet")
# 900 MB is what was seen; the others are as much as rover and router let through, and so most questions a second
SIZES = (900 << 20, 15 << 20, 60 << 10, 4 << 10)


@contextmanager
def ended(command: list[str], **options: Any) -> Iterator["subprocess.Popen[bytes]"]:
    with subprocess.Popen(command, cwd=ROOT, **options) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def reached(way: str, folder: Path) -> Iterator[tuple[str, str, Fleet | None]]:
    """[publish] of the rover, where it is reached, and the fleet whose router is between."""
    if way == "directly":
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        yield f'[publish]\nconnect = []\nlisten = ["{endpoint}"]\n', endpoint, None
        return
    with running_fleet(folder / "fleet") as fleet:
        file = fleet.rover_file("rover1")
        words = f'[publish]\nlisten = []\nconnect = ["{fleet.endpoint}"]\nconfig_file = "{file}"\n'
        yield words, fleet.endpoint, fleet


def besieged(group: MemoryGroup, way: str, size: int, folder: Path) -> dict[str, Any]:
    """Drive, let the flooders come for a minute, end in order; what was measured."""
    rover = ROVER.format(laser=free_port(), bus=free_port())
    (folder / "desk.toml").write_text(rover + "[simulation.world]\nseed = 1\n")
    infant = [sys.executable, str(ROOT / "infant.py")]
    with ExitStack() as stack:
        publish, endpoint, fleet = stack.enter_context(reached(way, folder))
        (folder / "rover.toml").write_text(rover + publish)
        files = (None if fleet is None else str(fleet.tool_file("viewer")),)
        stack.enter_context(
            ended(
                [*infant, "sim", "--config", str(folder / "desk.toml")], stdin=subprocess.PIPE, stdout=subprocess.PIPE
            )
        )
        run = [*infant, "run", "--config", str(folder / "rover.toml"), "--out", str(folder / "run"), "--json"]
        service = stack.enter_context(ended(group.command(*run), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL))

        def status() -> dict[str, Any] | None:
            return next(iter(fetch_status([endpoint], 1.0, files[0])), None)

        assert until(lambda: (status() or {}).get("seq") is not None, 300.0)
        time.sleep(SETTLED_S)
        before_mb = peak_mb = group.held_mb()
        words = [endpoint, "rover1", str(size), str(FLOOD_S), *filter(None, files)]
        flood = [sys.executable, "-m", "tests.support.zenoh.flooder", *words]
        flooders = [stack.enter_context(ended(flood, stdout=subprocess.PIPE)) for _ in range(FLOODERS)]
        asked = answered = 0
        waits = [(time.monotonic_ns(), kept_waiting_s(service.pid))]
        while any(each.poll() is None for each in flooders):
            asked, answered = asked + 1, answered + (status() is not None)
            peak_mb = max(peak_mb, group.held_mb())
            waits.append((time.monotonic_ns(), kept_waiting_s(service.pid)))
            time.sleep(0.2)
        said = [json.loads(each.stdout.read().splitlines()[-1]) for each in flooders if each.stdout is not None]
        service.send_signal(signal.SIGTERM)
        output, _ = service.communicate(timeout=120.0)
        summary = json.loads(output)
    return {
        "way": way,
        "kilobytes": size >> 10,
        "floods": {name: sum(each[name] for each in said) for name in said[0]},
        "code": service.returncode,
        "kills": group.kills(),
        "before_mb": round(before_mb, 1),
        "growth_mb": round(peak_mb - before_mb, 1),
        "ticks": summary["ticks"],
        "missed": summary["missed"],
        "missed_by_itself": missed_by_itself(folder / "run", waits),
        "lateness_ms": summary["lateness_ms"],
        "asked": asked,
        "answered": answered,
    }


def missed_by_itself(run: Path, waits: list[tuple[int, float]]) -> int:
    """Beats that were missed while the threads of the service had a processor whenever they could work.

    waits: what they had waited for one, seconds, by time of the monotonic clock, ns; nobody judges beats before these.
    """
    missed, last = 0, -1
    stamps_ns, waited_s = np.array([stamp_ns for stamp_ns, _ in waits]), [seconds for _, seconds in waits]
    for tick in (completed.tick for completed in RunReader(run).ticks()):
        beats, last = tick.seq - last - 1, tick.seq
        after = int(np.searchsorted(stamps_ns, tick.stamp_ns))
        before = int(np.searchsorted(stamps_ns, tick.stamp_ns - beats * PERIOD_NS)) - 1
        if beats and before >= 0 and after < len(waits) and waited_s[after] - waited_s[before] < OTHERS_S * beats:
            missed += beats
    return missed


def test_the_limit_kills_what_goes_beyond_it() -> None:
    """The trial would prove nothing without."""
    with memory_group(200 << 20) as group:
        ended = subprocess.run(group.command(sys.executable, "-c", "b'x' * (300 << 20)"), check=False)
        assert ended.returncode == -signal.SIGKILL
        assert group.kills() == 1


@pytest.mark.soak
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("way", WAYS)
def test_three_peers_that_flood_a_service_cost_it_neither_memory_nor_a_beat(
    way: str, size: int, tmp_path: Path
) -> None:
    with memory_group(LIMIT_BYTES) as group:
        figures = besieged(group, way, size, tmp_path)
    sys.stdout.write(json.dumps(figures) + "\n")
    assert (figures["code"], figures["kills"], figures["missed_by_itself"]) == (0, 0, 0)
    assert figures["growth_mb"] < GROWTH_MB
    if size > LARGEST_MESSAGE:  # of questions that a rover takes, the allowance is for all who ask
        assert figures["answered"] > 0.9 * figures["asked"]
