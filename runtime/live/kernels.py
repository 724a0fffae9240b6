"""The compiled kernels, loaded without what compiling them would leave in the loop's memory."""

import contextlib
import hashlib
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

from runtime.live.deadline import TimeIsOver
from slam.estimator import Estimator
from slam.kernel_cache import SOURCES, is_kept, use_compile_cache
from slam.settings.slam import SlamSettings

COMPILE = (sys.executable, "-c", "from slam.estimator import Estimator; Estimator.warm_up()")


KERNEL = re.compile(r"^@(?:kernel|leaf|inlined)$", re.MULTILINE)  # nearly each leaves an index file in the cache
POLL_S = 1.0
STILL_COMPILING = (
    ", while the kernels of the filter were being compiled: that happens once after each change of the program, "
    "and 'infant warmup' does it beforehand"
)


def load_kernels(settings: SlamSettings, tell: Callable[[str], None], stop: threading.Event) -> float:
    """Load every kernel, so that the first tick is as quick as the others; nothing once `stop` is set. Returns the
    seconds that compiling took.

    tell: told how far compiling is, where that is needed.

    Where the cache does not hold them a process of its own fills it: the compiler would leave 200 MB behind in this
    one. Should that fail, they are compiled here. What is compiled when it is broken off is kept.
    """
    cache = use_compile_cache(os.environ)
    began_s = ready_s = time.monotonic()
    if is_kept(cache) and not _marker(cache).exists():
        with subprocess.Popen(COMPILE, start_new_session=True) as compiling:  # Ctrl-C is for us: we end it
            try:
                _tell_progress(cache, compiling, tell, stop)
            except TimeIsOver:
                compiling.terminate()
                raise TimeIsOver(STILL_COMPILING) from None
        ready_s = time.monotonic()
    if not stop.is_set():
        Estimator.warm_up(settings)
        mark_complete(cache)
    return ready_s - began_s


def _tell_progress(
    cache: Path, compiling: "subprocess.Popen[bytes]", tell: Callable[[str], None], stop: threading.Event
) -> None:
    """Say how many kernels are compiled whenever that changes, until the process ends or is to end."""
    total = sum(len(KERNEL.findall(path.read_text(encoding="utf-8"))) for path in SOURCES.rglob("*.py"))
    began_s, shown = time.time() - 1.0, -1  # what is older is of another checkout, or of a start that was broken off
    while not stop.is_set():
        done = min(total, sum(path.stat().st_mtime >= began_s for path in cache.rglob("*.nbi")))
        if done != shown:
            tell(f"starting: compiling kernels {done} of {total} (once after each change of the program; Ctrl-C ends)")
            shown = done
        with contextlib.suppress(subprocess.TimeoutExpired):
            compiling.wait(POLL_S)
            return
    compiling.terminate()


def mark_complete(cache: Path) -> None:
    """Note that the cache holds every kernel of these files."""
    if is_kept(cache):
        _marker(cache).touch()


def _marker(cache: Path) -> Path:
    """Named by all that numba asks of a cached kernel: its file with its time, Python, and numba itself."""
    digest = hashlib.sha256(f"{sys.version}{version('numba')}".encode())
    for path in sorted(SOURCES.rglob("*.py")):
        status = path.stat()
        digest.update(f"{path}\0{status.st_mtime_ns}\0{status.st_size}\0".encode())
    return cache / f"complete-{digest.hexdigest()[:16]}"
