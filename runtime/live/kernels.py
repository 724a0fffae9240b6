"""The compiled kernels, loaded without what compiling them would leave in the loop's memory."""

import hashlib
import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

from slam.estimator import Estimator
from slam.kernel_cache import SOURCES, is_kept, use_compile_cache
from slam.settings.slam import SlamSettings

COMPILE = (sys.executable, "-c", "from slam.estimator import Estimator; Estimator.warm_up()")


def load_kernels(settings: SlamSettings) -> None:
    """Load every kernel, so that the first tick is as quick as the others.

    Where the cache does not hold them a process of its own fills it: the compiler would leave 200 MB behind in this
    one. Should that fail, they are compiled here.
    """
    cache = use_compile_cache(os.environ)
    if is_kept(cache) and not _marker(cache).exists():
        subprocess.run(COMPILE, check=False)
    Estimator.warm_up(settings)
    mark_complete(cache)


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
