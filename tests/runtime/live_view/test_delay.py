"""How late `infant view --live` draws; `make bench ARGS="-n 0 -s -k live_view"` prints it."""

import os
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from runtime.live_view.view import draw_live
from runtime.publish.find_rover import find_rover
from runtime.review.ticks import AssembledTick
from runtime.review.viewer import LOOPBACK, viewer_environment, viewer_path
from runtime.review.writer import ReviewWriter
from tests.support.runtime.live_rover import driving
from tests.support.zenoh.wire import free_port, until

pytest.importorskip("rerun", reason="rerun is not installed")
WATCHED_S, CUT_S, CUTS = 20.0, 5.0, 5
LATEST_S, BACK_S = 0.5, 2.0
LOOK_S = 0.2


@pytest.mark.bench
@pytest.mark.timeout(1800)
def test_a_live_view_shows_a_scan_soon_and_comes_back_after_a_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Up to where the viewer has taken the scan: what it takes to draw depends on the screen."""
    rover_port, cable_port = free_port(), free_port()
    cable, drawn = Cable(cable_port, rover_port), Drawn(monkeypatch)
    back_s = []
    with driving(tmp_path, f"tcp/127.0.0.1:{rover_port}"), cable.plugged_in(), viewing(f"tcp/127.0.0.1:{cable_port}"):
        assert until(lambda: len(drawn.at_s) > 20, 60.0), "nothing is drawn"
        drawn.late_s.clear()
        time.sleep(WATCHED_S)
        late_s = np.array(drawn.late_s)
        for _ in range(CUTS):
            cable.cut()
            time.sleep(CUT_S)
            again_s, before = time.monotonic(), len(drawn.at_s)
            cable.mend()
            assert until(lambda before=before: len(drawn.at_s) > before, 60.0), "it does not come back"  # type: ignore[misc]
            back_s.append(drawn.at_s[before] - again_s)
    low, median, high = np.quantile(late_s, (0.01, 0.5, 0.99))
    again = f"{max(back_s):.2f} s (median {np.median(back_s):.2f}, {CUTS} times; must be {BACK_S:.0f})"
    print(  # noqa: T201
        f"\nfrom scan to viewer: {median:.3f} s ({low:.3f} to {high:.3f} of 98 %, {len(late_s)} scans; "
        f"must be {LATEST_S}), after a cut of {CUT_S:.0f} s back within {again}; load {os.getloadavg()[0]:.1f}"
    )
    assert len(late_s) > 9.0 * WATCHED_S


class Drawn:
    """When each tick was handed to the viewer, s, and how late its scan was then."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.at_s: list[float] = []
        self.late_s: list[float] = []
        draw = ReviewWriter.draw

        def noted(writer: ReviewWriter, ticks: AssembledTick) -> None:
            draw(writer, ticks)
            self.at_s.append(time.monotonic())
            if ticks.tick.scan is not None:
                self.late_s.append((time.time_ns() - ticks.tick.scan.stamp_ns) * 1e-9)

        monkeypatch.setattr(ReviewWriter, "draw", noted)


class Cable:
    """Between a tool and a rover: it can be cut, and nobody is told."""

    def __init__(self, port: int, to_port: int) -> None:
        self._port, self._to_port = port, to_port
        self._is_cut = threading.Event()
        self._ends: list[socket.socket] = []

    @contextmanager
    def plugged_in(self) -> Iterator[None]:
        with socket.create_server(("127.0.0.1", self._port)) as server:
            threading.Thread(target=self._accept, args=(server,), daemon=True).start()
            try:
                yield
            finally:
                self.cut()

    def cut(self) -> None:
        """What was connected is gone, and nothing connects."""
        self._is_cut.set()
        for end in self._ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        self._ends.clear()

    def mend(self) -> None:
        """New connections come through."""
        self._is_cut.clear()

    def _accept(self, server: socket.socket) -> None:
        while True:
            try:
                near, _ = server.accept()
            except OSError:
                return
            if self._is_cut.is_set():
                near.close()
                continue
            try:
                far = socket.create_connection(("127.0.0.1", self._to_port))
            except OSError:
                near.close()
                continue
            self._ends += [near, far]
            for source, sink in ((near, far), (far, near)):
                threading.Thread(target=_carry, args=(source, sink), daemon=True).start()


def _carry(source: socket.socket, sink: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(1 << 16):
            sink.sendall(data)
    for end in (source, sink):
        with suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)


@contextmanager
def viewing(endpoint: str) -> Iterator[None]:
    """A viewer without a screen, drawn into by `infant view --live`."""
    port, stop = free_port(), threading.Event()
    command = [viewer_path(), "--serve-grpc", "--bind", LOOPBACK, "--port", str(port)]
    found = find_rover(endpoint, None)
    with subprocess.Popen(command, env={**viewer_environment(), "RUST_LOG": "error"}) as viewer:
        url = f"rerun+http://{LOOPBACK}:{port}/proxy"
        is_open: Callable[[], bool] = lambda: viewer.poll() is None  # noqa: E731
        words = (found, None, url, is_open, stop)
        drawing = threading.Thread(target=draw_live, args=words)
        try:
            time.sleep(LOOK_S)
            drawing.start()
            yield
        finally:
            stop.set()
            drawing.join()
            viewer.terminate()
