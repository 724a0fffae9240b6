"""A control group with a limit of memory, as systemd makes one of MemoryMax=: the kernel kills what goes beyond."""

import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

V1, V2 = Path("/sys/fs/cgroup/memory"), Path("/sys/fs/cgroup")
JOIN = 'echo $$ >"$0/cgroup.procs" && exec "$@"'


@dataclass(frozen=True, slots=True)
class MemoryGroup:
    """A group of its own at the top of the tree; is_v2: of the unified hierarchy."""

    path: Path
    is_v2: bool

    def command(self, *words: str | Path) -> list[str]:
        """A command line whose process, and all that it starts, live in the group."""
        return ["/bin/sh", "-c", JOIN, str(self.path), *map(str, words)]

    def pids(self) -> list[int]:
        """Whoever lives in it now."""
        return [int(line) for line in (self.path / "cgroup.procs").read_text().split()]

    def held_mb(self) -> float:
        """Memory of its processes in units of 10^6 bytes; what the kernel keeps of their files is not counted."""
        return self._figures("memory.stat")["anon" if self.is_v2 else "rss"] * 1e-6

    def kills(self) -> int:
        """How many processes were killed for memory."""
        return self._figures("memory.events" if self.is_v2 else "memory.oom_control")["oom_kill"]

    def _figures(self, name: str) -> dict[str, int]:
        words = [line.split() for line in (self.path / name).read_text().splitlines()]
        return {key: int(value) for key, value in words}


@contextmanager
def memory_group(limit_bytes: int) -> Iterator[MemoryGroup]:
    """Skips the test where this machine lets us make none; ends whoever is left in it."""
    is_v2 = (V2 / "cgroup.controllers").exists()
    group = MemoryGroup((V2 if is_v2 else V1) / f"infant-test-{os.getpid()}", is_v2)
    try:
        group.path.mkdir()
        (group.path / ("memory.max" if is_v2 else "memory.limit_in_bytes")).write_text(str(limit_bytes))
    except OSError as error:
        pytest.skip(f"no control group with a limit of memory: {error}")
    try:
        yield group
    finally:
        while left := group.pids():
            subprocess.run(["kill", "-9", *map(str, left)], check=False, stderr=subprocess.DEVNULL)
            time.sleep(0.05)
        group.path.rmdir()
