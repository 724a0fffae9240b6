"""Does the loop keep its rate beside busy processes? A run of its own, with and without real-time privileges."""

import ctypes
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from runtime.errors import SensorError

HOG = "while True: pass"
FSYNC_LOOP = """
import os, sys
handle = os.open(sys.argv[1], os.O_RDWR | os.O_CREAT)
while True:
    os.pwrite(handle, os.urandom(4096), 0)
    os.fsync(handle)
"""
PR_SET_PDEATHSIG, PR_CAPBSET_DROP = 1, 24  # linux/prctl.h
PRIVILEGES = (14, 23, 24)  # linux/capability.h: CAP_IPC_LOCK, CAP_SYS_NICE, CAP_SYS_RESOURCE
ORDINARY_LOCKED = 8 << 20  # bytes that Linux lets anyone lock; zenoh needs some, the whole program does not fit
RATE_TOLERANCE = 1e-3
DRIFT_HZ = 1e-5  # a beat in a day
WAKE_P99_MS, WAKE_MAX_MS, OVERHEAD_P99_MS = 5.0, 20.0, 2.0


def measure_rate(
    config: Path, minutes: float, hogs: int, syncing: bool, privileged: bool, overrides: list[str]
) -> dict[str, Any]:
    """The summary of a run of `minutes` beside so many busy processes and a loop of fsync on the same disk.

    Raises SensorError when the run does not come to an end; its message stands on standard error.
    """
    with tempfile.TemporaryDirectory(prefix="infant-rate-", dir=Path.cwd()) as name:
        folder = Path(name)
        words = [word for override in overrides for word in ("--set", override)]
        command = [
            sys.executable,
            "-m",
            "runtime.cli",
            "run",
            "--config",
            str(config),
            "--duration",
            str(60.0 * minutes),
            "--out",
            str(folder / "run"),
            "--json",
            *words,
        ]
        with busy_processes(hogs, folder / "synced" if syncing else None):
            load = os.getloadavg()[0]
            done = subprocess.run(
                command, stdout=subprocess.PIPE, text=True, preexec_fn=None if privileged else give_up_privileges
            )
    if done.returncode != 0:
        raise SensorError(f"the run ended with exit code {done.returncode}; its message is printed above")
    summary: dict[str, Any] = json.loads(done.stdout)
    return {
        "minutes": minutes,
        "hogs": hogs,
        "fsync": syncing,
        "privileged": privileged,
        "load_before": round(load, 2),
        "load_after": round(os.getloadavg()[0], 2),
        **{key: summary[key] for key in ("ticks", "missed", "rate_hz", "beat_hz")},
        **{key: summary[key] for key in ("lateness_ms", "tick_ms", "overhead_ms", "stages_ms")},
    }


def rate_lines(measured: dict[str, Any]) -> list[str]:
    """Each figure beside what it must be; without privileges beats may be missed, but not uncounted."""
    late, overhead = measured["lateness_ms"], measured["overhead_ms"]["p99"]
    privileged = measured["privileged"]
    rate_off = abs(measured["rate_hz"] / 10.0 - 1.0)
    no_drift = abs(measured["beat_hz"] - 10.0) <= DRIFT_HZ
    rows = [("beats", f"{measured['beat_hz']:.6f} Hz", "10 Hz, no drift", no_drift)]
    if privileged:
        rows += [
            ("rate", f"{measured['rate_hz']:.4f} Hz", "10.00 Hz +- 0.1 %", rate_off <= RATE_TOLERANCE),
            ("overhead p99", f"{overhead:.2f} ms", f"{OVERHEAD_P99_MS:g} ms", overhead <= OVERHEAD_P99_MS),
            ("missed", str(measured["missed"]), "0", measured["missed"] == 0),
            ("wake-up p99", f"{late['p99']:.2f} ms", f"{WAKE_P99_MS:g} ms", late["p99"] <= WAKE_P99_MS),
            ("wake-up max", f"{late['max']:.2f} ms", f"{WAKE_MAX_MS:g} ms", late["max"] <= WAKE_MAX_MS),
        ]
    head = (
        f"{measured['minutes']:g} min, {measured['hogs']} hogs, fsync loop {'on' if measured['fsync'] else 'off'}, "
        f"{'with' if privileged else 'without'} real-time privileges, "
        f"load {measured['load_before']} before and {measured['load_after']} after"
    )
    lines = [head]
    lines += [f"{name:14s} {value:>12s}  must {must:18s} {'ok' if ok else 'NOT MET'}" for name, value, must, ok in rows]
    if not privileged:
        lines.append(f"missed {measured['missed']} beats, {measured['rate_hz']:.4f} Hz kept")
        lines.append(f"wake-up p99 {late['p99']:.2f} ms, max {late['max']:.2f} ms; overhead p99 {overhead:.2f} ms")
    return lines + [
        f"  {name:20s} p50 {took['p50']:8.3f}  p99 {took['p99']:8.3f}  max {took['max']:8.3f} ms"
        for name, took in measured["stages_ms"].items()
    ]


@contextmanager
def busy_processes(hogs: int, synced: Path | None) -> Iterator[None]:
    """Processes that take what they can get of the processor and of the disk."""
    programs = [[HOG]] * hogs + ([[FSYNC_LOOP, str(synced)]] if synced is not None else [])
    processes = [
        subprocess.Popen([sys.executable, "-c", *words], preexec_fn=end_with_parent, start_new_session=True)
        for words in programs
    ]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def end_with_parent() -> None:
    """In the child: a busy process that nobody ends would stay for ever."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)


def give_up_privileges() -> None:
    """In the child, before the program: neither real-time priority nor locked memory, even for root."""
    libc = ctypes.CDLL(None, use_errno=True)
    for capability in PRIVILEGES:
        libc.prctl(PR_CAPBSET_DROP, capability, 0, 0, 0)
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (ORDINARY_LOCKED, ORDINARY_LOCKED))
