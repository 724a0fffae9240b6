"""A machine of its own for the service: a kernel with SocketCAN as a process, systemd as its first process.

The host's programs are seen read-only; /etc, /var and /opt lie on an image of ext4, which outlives a loss of power
(the process is killed). Anyone with root on an x86-64 Debian with systemd can run it: `make system`.
"""

import contextlib
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import time
from pathlib import Path
from typing import Any

from runtime.source_tree import ROOT as TREE
from slam.kernel_cache import sources_hash
from tests.system.bench.can_bench import NICE, BenchUnavailableError, bench_root, preloaded

NEEDED = ("/lib/systemd/systemd", "/usr/bin/journalctl", "/usr/bin/systemctl")
MEMORY = "1500M"
FIRST_LIMIT_S = 1800.0  # compiling the kernels in there takes minutes of a busy machine, once
SECOND_LIMIT_S = 120.0
POWER_S = (6.0, 12.0)  # the power goes so long after the service runs

Results = dict[str, dict[str, Any]]


def run_service_bench(folder: Path) -> Results:
    """Boot, let systemd_guest.py do all that a field does, cut the power, boot again; results by name.

    Raises BenchUnavailableError where the machine cannot do it.
    """
    check_host()
    root = bench_root(folder)
    kept = folder / f"kernels-{kernels_name()}.tar"
    with tempfile.TemporaryDirectory(prefix="infant-bench-", dir=folder) as given:
        work = Path(given)
        disk = work / "disk.ext4"
        with disk.open("wb") as file:
            file.truncate(2 << 30)
        subprocess.run(["/sbin/mke2fs", "-q", "-t", "ext4", str(disk)], check=True)
        if kept.exists():
            shutil.copyfile(kept, work / "kernels.tar")
        with guest(folder, root, work, "first") as machine:
            if not wait_for(machine, lambda: "power" in results(work), FIRST_LIMIT_S):
                raise BenchUnavailableError(f"the guest did not come to its end; {last_words(work)}")
            time.sleep(random.uniform(*POWER_S))
            os.killpg(machine.pid, signal.SIGKILL)
        if not kept.exists() and (work / "kernels.tar").exists():
            for old in folder.glob("kernels-*.tar"):
                old.unlink()
            shutil.copyfile(work / "kernels.tar", kept)
        with guest(folder, root, work, "again") as machine:
            if not wait_for(machine, lambda: "power_is_back" in results(work), SECOND_LIMIT_S):
                raise BenchUnavailableError(f"the guest did not start again; {last_words(work)}")
        return results(work)


def check_host() -> None:
    """Raises BenchUnavailableError with what is missing."""
    missing = [path for path in NEEDED if not Path(path).exists()]
    if missing:
        raise BenchUnavailableError(f"needs {', '.join(missing)} (package systemd)")
    if os.geteuid() != 0:
        raise BenchUnavailableError("needs root: the files of the image belong to it")
    if not Path("/sbin/mke2fs").exists():
        raise BenchUnavailableError("needs /sbin/mke2fs (package e2fsprogs)")


def kernels_name() -> str:
    """Names the state of what the kernels are compiled from, and by what."""
    return f"{sources_hash()}-{hashlib.sha256(sys.version.encode()).hexdigest()[:8]}"


class guest:  # noqa: N801 a context manager that reads as a word
    """A running machine; killed at the end of the block like one whose plug is pulled."""

    def __init__(self, folder: Path, root: Path, work: Path, what: str) -> None:
        self._folder, self._root, self._work, self._what = folder, root, work, what

    def __enter__(self) -> "subprocess.Popen[bytes]":
        script = self._work / "guest.sh"
        script.write_text(f"exec /opt/infant/.venv/bin/python -m tests.system.bench.systemd_guest {self._what}\n")
        given = {
            "BENCH_TREE": TREE,
            "BENCH_ROOT": self._root,
            "BENCH_REPORT": self._work,
            "BENCH_BASE": sys.base_prefix,
            "BENCH_PYTHON": f"{sys.version_info.major}.{sys.version_info.minor}",
            "BENCH_SITE": sysconfig.get_path("purelib"),
        }
        command = [
            str(self._root / "usr" / "bin" / "linux.uml"),
            f"mem={MEMORY}",
            f"ubd0={self._work / 'disk.ext4'}",
            "root=/dev/root",
            "rootfstype=hostfs",
            "rootflags=/",
            "ro",
            "quiet",
            "systemd.show_status=0",
            f"init={Path(__file__).with_name('systemd_init.sh')}",
            "con=null",
            "con0=null,fd:1",
            "ssl=null",
            *(f"{key}={value}" for key, value in given.items()),
        ]
        environment = {"HOME": str(self._work), "TMPDIR": "/dev/shm", "PATH": os.environ["PATH"]}
        with (self._work / "console").open("ab") as console:
            self._machine = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=console,
                env=environment | preloaded(self._folder),
                start_new_session=True,
            )
        with contextlib.suppress(PermissionError):  # it is judged by the clock, on machines that do other things too
            os.setpriority(os.PRIO_PGRP, self._machine.pid, NICE)
        return self._machine

    def __exit__(self, *_reason: object) -> None:
        if self._machine.poll() is None:
            os.killpg(self._machine.pid, signal.SIGKILL)
        self._machine.wait()


def wait_for(machine: "subprocess.Popen[bytes]", condition: Any, limit_s: float) -> bool:
    """Whether it became so while the machine ran."""
    deadline_s = time.monotonic() + limit_s
    while time.monotonic() < deadline_s and machine.poll() is None:
        if condition():
            return True
        time.sleep(0.2)
    return bool(condition())


def results(work: Path) -> Results:
    """What the guest has reported so far."""
    path = work / "results.jsonl"
    lines = path.read_text().splitlines(keepends=True) if path.exists() else []
    whole = [json.loads(line) for line in lines if line.endswith("\n")]
    return {result["name"]: result for result in whole}


def last_words(work: Path) -> str:
    """What helps to see why it stopped."""
    said = [(work / name).read_text(errors="replace") for name in ("console", "said") if (work / name).exists()]
    return f"reported so far: {sorted(results(work))}; its last words: {' '.join(said)[-1500:]}"
