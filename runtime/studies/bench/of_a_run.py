"""What looking at a recorded run costs: time and memory of `infant review` and `infant export --ros2`.

Light on purpose: the system counts the memory of whoever starts a program as that of the program.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from runtime.errors import UsageError
from runtime.studies.bench.figure import BenchFigure

SMALL_PARENT = """
import json, os, signal, subprocess, sys
signal.signal(signal.SIGINT, signal.SIG_DFL)  # the command that it measures ends by Ctrl-C as well
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
_, status, used = os.wait4(process.pid, 0)
print(json.dumps((os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime, used.ru_maxrss)))
"""
"""Linux counts to a process what the one that started it held at that moment: a large one would be measured itself."""


class Cost(NamedTuple):
    """Seconds by the clock and of the processors, and the memory of the largest process at its peak."""

    wall_s: float
    cpu_s: float
    peak_mb: float


def measure_run(run: Path) -> Iterator[BenchFigure]:
    """Figures of one run, from a copy beside it: a review draws its picture again. Raises UsageError."""
    if not any(run.glob("run*.mcap")):
        raise UsageError(f"{run}: expected the folder of a run, which holds run.mcap; give one, such as runs/yard")
    with tempfile.TemporaryDirectory(prefix="infant-bench-", dir=run.absolute().parent) as name:
        copy = Path(name, "run")
        shutil.copytree(run, copy, ignore=_no_files)
        review = cost_of("review", str(copy))
        recorded_s: float = json.loads((copy / "report.json").read_text())["duration_s"]
        export = cost_of("export", str(copy), "--ros2", str(Path(name, "bag")))
    yield BenchFigure("recorded", recorded_s, "s")
    for command, cost in (("review", review), ("export_ros2", export)):
        yield BenchFigure(f"{command}_wall", round(cost.wall_s, 2), "s")
        yield BenchFigure(f"{command}_cpu", round(cost.cpu_s, 2), "s")
        yield BenchFigure(f"{command}_memory", round(cost.peak_mb, 1), "MB")


def _no_files(folder: str, _names: list[str]) -> list[str]:
    """What is not copied: folders, pipes, and links, which may lead anywhere."""
    with os.scandir(folder) as entries:
        return [entry.name for entry in entries if not entry.is_file(follow_symlinks=False)]


def cost_of(*words: str) -> Cost:
    """Run one `infant` command in a process of its own. Raises UsageError where it fails; it has said why."""
    began_s = time.monotonic()
    command = [sys.executable, "-S", "-c", SMALL_PARENT, sys.executable, "-m", "runtime.cli", *words]
    told = subprocess.run(command, stdout=subprocess.PIPE, check=False).stdout
    code, cpu_s, largest_kb = json.loads(told)
    if code:
        raise UsageError(f"infant {' '.join(words[:2])}: exit code {code}; its message is printed above")
    return Cost(time.monotonic() - began_s, cpu_s, largest_kb / 1024.0)
