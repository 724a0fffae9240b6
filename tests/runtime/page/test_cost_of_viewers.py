"""What the page of a rover costs, and what viewers see; `make bench ARGS="-n 0 -s -k viewers"` prints it."""

import os
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pytest

from runtime.page.hub import BEATS_HZ
from runtime.record.reader import RunReader
from tests.support.browser import browser, needs_chromium
from tests.support.runtime.live_rover import driving, started
from tests.support.zenoh.wire import free_port, until

pytestmark = pytest.mark.bench
READING, STALLED = 49, 1
WATCHED_S = 20.0
PAINTED = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? null"


@pytest.mark.timeout(900)
def test_fifty_viewers_one_of_them_stalled_leave_the_loop_alone(tmp_path: Path) -> None:
    endpoint, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    with driving(tmp_path, endpoint), serving(tmp_path, endpoint, port) as page:
        nobody = span()
        alone = Watch(port, 1, 0)
        one = alone.watch(page.pid)
        fifty = Watch(port, READING, STALLED)
        many = fifty.watch(page.pid)
    loop = [loop_during(tmp_path / "run", during) for during in (nobody, alone.during, fifty.during)]
    for who, watch, cost in (("one viewer", alone, one), ("fifty, one stalled", fifty, many)):
        rates = watch.beats_hz()
        print(  # noqa: T201
            f"\n{who}: {min(rates):.2f} to {max(rates):.2f} beats a second (must be {BEATS_HZ:.0f}), "
            f"{100.0 * cost:.1f} % of a core in the page's own process (must be 5 with one)"
        )
    for who, (missed, p99_ms) in zip(("nobody watches", "one", "fifty"), loop, strict=True):
        print(f"{who}: {missed} missed beats, p99 of a step {p99_ms:.1f} ms; load {os.getloadavg()[0]:.1f}")  # noqa: T201
    assert min(fifty.beats_hz()) > 0.9 * BEATS_HZ
    assert loop[2][0] == 0


@needs_chromium
@pytest.mark.timeout(900)
def test_viewers_see_the_page_painted_soon(tmp_path: Path) -> None:
    endpoint, port, painted_ms = f"tcp/127.0.0.1:{free_port()}", free_port(), []
    with driving(tmp_path, endpoint), serving(tmp_path, endpoint, port), browser(tmp_path / "chrome") as page:
        for _ in range(10):
            page.open(f"http://127.0.0.1:{port}/")
            assert until(lambda: page.value(PAINTED) is not None, 30.0)
            painted_ms.append(float(page.value(PAINTED)))
            page.open("about:blank")
    low, median, high = np.quantile(painted_ms, (0.0, 0.5, 1.0))
    print(f"\nfirst paint after {median:.0f} ms ({low:.0f} to {high:.0f}, ten times; must be 1000)")  # noqa: T201
    assert len(painted_ms) == 10


class Watch:
    """Viewers of the stream of events: some read all, others nothing but their first kilobyte."""

    def __init__(self, port: int, reading: int, stalled: int) -> None:
        self._port, self._reading, self._stalled = port, reading, stalled
        self._beats = [0] * reading
        self.during = (0, 0)

    def watch(self, page: int) -> float:
        """Watch for a while; the share of a core that the process of the page took meanwhile."""
        stop = threading.Event()
        asleep = [self._connected() for _ in range(self._stalled)]
        threads = [threading.Thread(target=self._read, args=(number, stop)) for number in range(self._reading)]
        for thread in threads:
            thread.start()
            time.sleep(0.05)  # a page lets 30 requests a second in
        before_s, self._beats = cpu_s(page), [0] * self._reading
        self.during = span()
        after_s = cpu_s(page)
        self._counted = list(self._beats)
        stop.set()
        for thread in threads:
            thread.join()
        for client in asleep:
            client.close()
        return (after_s - before_s) / WATCHED_S

    def beats_hz(self) -> list[float]:
        """How often each reader was told the state."""
        return [beats / WATCHED_S for beats in self._counted]

    def _connected(self) -> socket.socket:
        client = socket.create_connection(("127.0.0.1", self._port), 5.0)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.sendall(b"GET /events HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n\r\n" % self._port)
        assert client.recv(1024).startswith(b"HTTP/1.1 200")
        return client

    def _read(self, number: int, stop: threading.Event) -> None:
        with closing(self._connected()) as client:
            while not stop.is_set():
                self._beats[number] += client.recv(1 << 16).count(b"event: beat")


@contextmanager
def serving(folder: Path, endpoint: str, port: int) -> Iterator["subprocess.Popen[bytes]"]:
    """The page of that rover."""
    with started("page", "--connect", endpoint, "--port", str(port), "--runs", str(folder)) as page:
        assert until(lambda: listens(port), 60.0), "the page does not come up"
        yield page


def listens(port: int) -> bool:
    with socket.socket() as client:
        return client.connect_ex(("127.0.0.1", port)) == 0


def span() -> tuple[int, int]:
    """Beginning and end of some seconds on the clock of the loop."""
    began_ns = time.monotonic_ns()
    time.sleep(WATCHED_S)
    return began_ns, time.monotonic_ns()


def cpu_s(pid: int) -> float:
    """CPU time of a process so far, in s."""
    user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def loop_during(run: Path, during: tuple[int, int]) -> tuple[int, float]:
    """Beats that the loop missed, and the 99th percentile of its steps in ms."""
    timings = [
        recorded.timing
        for recorded in RunReader(run, tolerant=True).ticks()
        if during[0] <= recorded.tick.stamp_ns <= during[1]
    ]
    told = [timing for timing in timings if timing is not None]
    assert len(told) > 0.8 * 10.0 * WATCHED_S
    return sum(timing.missed for timing in told), float(np.quantile([t.stages_ns["step"] * 1e-6 for t in told], 0.99))
