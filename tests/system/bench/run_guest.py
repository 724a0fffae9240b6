"""What runs inside the guest: the command `infant run` against vcan and kernel slcan, while the bus misbehaves.

Nothing is judged here: the phases are told to the host with their times, and the host reads the record.
"""

import json
import os
import pty
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.system.bench.guest import BURST_FRAMES, burst, inject_error, load_modules, report, shell

OUT = Path("/run/out")
LASER_PORT = 10940
FLOOD_FRAMES = 500  # of a wheel's id with wrong checksums: each is looked at, unlike those of foreign ids
SETTLE_S = 3.5  # after each phase, of which the first second is for the way back
STARTED_S = 15.0
END_S = 60.0
LEFT_ID, RIGHT_ID = 0x181, 0x182
# slow, because a guest without real time stamps late by tens of ms; no slip, so that every count is accounted for
ROVER = """
rover = "bench"
[vehicle]
wheel_radius_left_m = 0.125
wheel_radius_right_m = 0.125
tread_m = 0.5
counts_per_rev = 4096
[encoders.bus]
interface = "socketcan"
channel = "{channel}"
[slam.mount]
x_m = 0.3
[review]
live = false
[laser]
url = "tcp://127.0.0.1:{port}"
"""
SIMULATION = """
[simulation.laser]
port = {port}
[simulation.wheels]
slip_std_per_m = 0.0
[simulation.world.drive]
speed_mps = 0.1
"""


def configuration(name: str, channel: str, port: int, simulated: bool) -> Path:
    """A file for `infant`."""
    path = Path("/run") / f"{name}.toml"
    text = ROVER.format(channel=channel, port=port) + (SIMULATION.format(port=port) if simulated else "")
    path.write_text(text)
    return path


@contextmanager
def infant(*words: object) -> "Iterator[subprocess.Popen[str]]":
    """The command as a user types it, ended with the block."""
    with subprocess.Popen(
        [sys.executable, "-m", "runtime.cli", *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ
        | {"NUMBA_CACHE_DIR": "/run/kernels", "HOME": "/run", "TMPDIR": "/run", "OPENBLAS_NUM_THREADS": "1"},
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def started(run: Path, process: "subprocess.Popen[str]") -> None:
    """Wait until the loop turns: the record has got its first ticks."""
    deadline = time.monotonic() + 60.0
    record = run / "run.mcap"
    while process.poll() is None and time.monotonic() < deadline:
        if record.exists() and record.stat().st_size > 100_000:
            return
        time.sleep(0.1)


def end(name: str, process: "subprocess.Popen[str]", number: signal.Signals) -> None:
    """End the command by a signal and tell how it ended."""
    alive = process.poll() is None
    began = time.monotonic()
    if alive:
        process.send_signal(number)
    try:
        out, err = process.communicate(timeout=END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        out, err = process.communicate()
    report(name, alive=alive, code=process.returncode, seconds=time.monotonic() - began, out=out, err=err[-2000:])


def phase(name: str, begin: Callable[[], None], hold_s: float, over: Callable[[], None] | None = None) -> None:
    """Trouble for a while; its times are those of the monotonic clock, like all stamps in the record."""
    began_ns = time.monotonic_ns()
    begin()
    time.sleep(hold_s)
    if over is not None:
        over()
    report(f"phase {name}", began_ns=began_ns, ended_ns=time.monotonic_ns())
    time.sleep(SETTLE_S)


def set_clock(hours: float) -> None:
    time.clock_settime(time.CLOCK_REALTIME, time.time() + 3600.0 * hours)


def drive_on_vcan() -> None:
    """One drive with everything that a bus does, ended by Ctrl-C."""
    config = configuration("vcan", "vcan0", 0, simulated=True)
    with infant("run", "--config", config, "--out", OUT / "vcan", "--duration", 300, "--json") as process:
        started(OUT / "vcan", process)
        phase("quiet", lambda: None, SETTLE_S)
        phase("down", lambda: shell("ip link set vcan0 down"), 1.0, lambda: shell("ip link set vcan0 up"))
        make = "ip link add vcan0 type vcan && ip link set vcan0 up"
        phase("deleted", lambda: shell("ip link del vcan0"), 1.0, lambda: shell(make))
        phase("bus_off", lambda: inject_error(0x40, bytes(8)), 0.3, lambda: inject_error(0x100, bytes(8)))
        phase("burst", burst, 0.0)
        phase("flood", lambda: burst(LEFT_ID, FLOOD_FRAMES), 0.0)
        phase("clock", lambda: set_clock(1.0), 0.0)
        phase("clock_back", lambda: set_clock(-1.0), 0.0)
        end("vcan", process, signal.SIGINT)


class SerialAdapter:
    """A serial CAN adapter: what is on vcan0 comes out of a pseudo-terminal as SLCAN text, with some line noise."""

    def __init__(self) -> None:
        self.leader, self.follower = pty.openpty()
        tty.setraw(self.leader)
        tty.setraw(self.follower)
        self.sent: list[tuple[int, int, int]] = []  # monotonic ns, id, count
        self.noise = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
            raw.bind(("vcan0",))
            raw.settimeout(0.2)
            while not self._stop.is_set():
                try:
                    number, length, data = struct.unpack("=IB3x8s", raw.recv(16))
                except TimeoutError:
                    continue
                self.sent.append((time.monotonic_ns(), number, int.from_bytes(data[:4], "little")))
                os.write(self.leader, f"t{number:03X}{length}{data[:length].hex().upper()}\r".encode())
                if len(self.sent) % 100 == 0:
                    os.write(self.leader, b"t18ZZ\rt1812\xff\xfe\r")
                    self.noise += 1


def drive_on_slcan() -> None:
    """One drive with the wheels behind kernel slcan, ended as systemd ends it."""
    simulation = configuration("desk", "vcan0", LASER_PORT, simulated=True)
    config = configuration("slcan", "slcan0", LASER_PORT, simulated=False)
    adapter = SerialAdapter()
    shell(f"slcand -o -s6 {os.ttyname(adapter.follower)} slcan0")
    for _ in range(200):
        if Path("/sys/class/net/slcan0").exists():
            break
        time.sleep(0.02)
    shell("ip link set slcan0 up")
    with infant("sim", "--config", simulation) as desk:
        assert desk.stdout is not None
        desk.stdout.readline()
        with infant("run", "--config", config, "--out", OUT / "slcan", "--json") as process:
            started(OUT / "slcan", process)
            phase("slcan", lambda: None, 4.0)
            end("slcan", process, signal.SIGTERM)
        end("desk", desk, signal.SIGINT)
    adapter.close()
    (OUT / "sent.json").write_text(json.dumps(adapter.sent))
    report("adapter", frames=len(adapter.sent), noise=adapter.noise, burst=BURST_FRAMES)


def main(root: Path) -> None:
    load_modules(root)
    shell("ip link add vcan0 type vcan && ip link set vcan0 up")
    shutil.copytree(os.environ["BENCH_KERNELS"], "/run/kernels")
    steps: tuple[Callable[[], Any], ...] = (drive_on_vcan, drive_on_slcan)
    for step in steps:
        step()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
