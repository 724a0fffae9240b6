"""Boot a kernel that has CAN, as a plain process: User-Mode Linux with the host's own files, no image, no systemd.

Needs an x86-64 Debian with apt and the package mirror once; root is not needed where apt can download.
"""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from runtime.source_tree import ROOT as TREE
from slam.kernel_cache import use_compile_cache

PACKAGES = ("user-mode-linux", "can-utils")
MARK = "RESULT "
BOOT_LIMIT_S = 150
NICE = -10


class BenchUnavailableError(Exception):
    """The bench cannot be had on this machine; the message says why."""


def bench_root(folder: Path) -> Path:
    """Kernel, modules and can-utils, fetched once into a folder."""
    root = folder / "root"
    if (root / "usr" / "bin" / "linux.uml").exists() and (root / "usr" / "bin" / "slcand").exists():
        return root
    if shutil.which("apt-get") is None or os.uname().machine != "x86_64":
        raise BenchUnavailableError("needs apt-get on an x86-64 Debian")
    folder.mkdir(parents=True, exist_ok=True)
    fetched = subprocess.run(
        ["apt-get", "download", "-qq", *PACKAGES], cwd=folder, capture_output=True, text=True, check=False
    )
    if fetched.returncode:
        raise BenchUnavailableError(f"apt-get download {' '.join(PACKAGES)}: {fetched.stderr.strip()[-200:]}")
    for package in folder.glob("*.deb"):
        subprocess.run(["dpkg-deb", "-x", str(package), str(root)], check=True)
    return root


def preloaded(folder: Path) -> dict[str, str]:
    """What the kernel process needs on hosts whose registers it does not know; see xstate.c."""
    if "amx_tile" not in Path("/proc/cpuinfo").read_text():
        return {}
    library = folder / "xstate.so"
    if not library.exists():
        if shutil.which("gcc") is None:
            raise BenchUnavailableError("User-Mode Linux 6.1 dies on CPUs with AMX; gcc is needed for the way round")
        source = Path(__file__).with_name("xstate.c")
        subprocess.run(["gcc", "-O1", "-shared", "-fPIC", "-o", str(library), str(source), "-ldl"], check=True)
    return {"LD_PRELOAD": str(library)}


def kernels_of(tree: Path) -> Path:
    """The folder with the compiled kernels of this tree, compiled here if need be: the guest would take minutes."""
    folder = use_compile_cache(os.environ)
    program = "from slam.estimator import Estimator; Estimator.warm_up()"
    subprocess.run([sys.executable, "-c", program], cwd=tree, env=os.environ | {"PYTHONPATH": str(tree)}, check=True)
    return folder


def run_bench(
    folder: Path, program: str = "can_guest", limit_s: float = BOOT_LIMIT_S, out: Path | None = None, task: str = ""
) -> dict[str, dict[str, Any]]:
    """Boot, let a program of this folder run in the guest, and give back its results by name.

    out: a folder of the host that the guest may write to; it sees it as /run/out. task: BENCH_TASK in the guest.
    """
    root = bench_root(folder)
    environment: dict[str, str | Path] = {
        "BENCH_TREE": TREE,
        "BENCH_ROOT": root,
        "BENCH_PYTHON": sys.executable,
        "BENCH_PROGRAM": program,
        "BENCH_TASK": task,
    }
    if out is not None:
        environment |= {"BENCH_OUT": out, "BENCH_KERNELS": kernels_of(TREE)}
    kernel = root / "usr" / "bin" / "linux.uml"
    command = [
        str(kernel),
        "mem=1024M",
        "root=/dev/root",
        "rootfstype=hostfs",
        "rootflags=/",
        "ro",
        "quiet",
        f"init={Path(__file__).with_name('guest_init.sh')}",
        "con=null",
        "con0=null,fd:1",
        "ssl=null",
        *(f"{key}={value}" for key, value in environment.items()),
    ]
    host = {"HOME": str(folder), "TMPDIR": "/dev/shm", "PATH": os.environ["PATH"]}
    said = boot(command, host | preloaded(folder), limit_s)
    results = [json.loads(line[len(MARK) :]) for line in said.splitlines() if line.startswith(MARK)]
    if not results:
        raise BenchUnavailableError(f"the guest reported nothing; its last words: {said[-1500:]}")
    return {result["name"]: result for result in results}


def boot(command: list[str], environment: dict[str, str], limit_s: float = BOOT_LIMIT_S) -> str:
    """What the guest wrote on its console. Its kernel is a group of processes, ended as one."""
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        env=environment,
        start_new_session=True,
    ) as guest:
        with contextlib.suppress(PermissionError):  # it is judged by the clock, on machines that do other things too
            os.setpriority(os.PRIO_PGRP, guest.pid, NICE)
        try:
            return guest.communicate(timeout=limit_s)[0]
        except subprocess.TimeoutExpired as error:
            os.killpg(guest.pid, signal.SIGKILL)
            return (error.output or b"").decode(errors="replace")
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(guest.pid, signal.SIGKILL)
