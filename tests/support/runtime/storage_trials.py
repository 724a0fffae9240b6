"""Trials of the recorder on a disk that fails, and of one that is killed: run as a process of its own by the tests.

    python -m tests.support.runtime.storage_trials faults FOLDER CYCLES    inside `unshare -rm`: it mounts a small disk
    python -m tests.support.runtime.storage_trials kills FOLDER TIMES
Prints one JSON object.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.reader import RunReader
from runtime.record.writing.recorder import Recorder
from runtime.settings.record import RecordSettings
from runtime.tick import CompletedTick
from tests.support.runtime.recorded_values import make_estimate, make_tick, make_timing

TICK_S = 0.02
DISK = "size=6m"
PATIENCE_S = 600.0


class Drive:
    """Puts ticks at a steady rate and notes how long each put takes."""

    def __init__(self, path: Path, settings: RecordSettings) -> None:
        self.recorder = Recorder(RunFolder.create(path, path), RunHeader.of_live_run("seed = 1\n", {}), settings)
        self.rng = np.random.default_rng(1)
        self.seq = 0
        self.puts_s: list[float] = []

    def tick(self) -> None:
        tick = make_tick(self.seq, self.rng, "scan", 200)
        estimate = make_estimate(tick.stamp_ns, self.rng, 200)
        began_s = time.perf_counter()
        self.recorder.put(CompletedTick(tick, estimate, make_timing(self.seq), bytes(16), None))
        self.recorder.health()
        self.puts_s.append(time.perf_counter() - began_s)
        self.seq += 1
        time.sleep(TICK_S)

    def until(self, condition: Callable[[], bool], what: str) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not condition():
            if time.monotonic() > deadline_s:
                raise TimeoutError(f"{what}; {self.recorder.health()}")
            self.tick()

    def until_trouble(self, is_there: bool, what: str) -> str:
        self.until(lambda: bool(self.recorder.health().trouble) is is_there, what)
        return self.recorder.health().trouble

    def go_on(self, ticks: int) -> None:
        for _ in range(ticks):
            self.tick()


def mount(*words: str) -> None:
    subprocess.run(["mount", *words], check=True)


def full(disk: Path, number: int) -> Callable[[], None]:
    """Fill the disk to the last byte; healed by taking the filler away."""
    filler = disk / f"filler-{number}"
    with filler.open("wb", buffering=0) as stream:
        try:
            while True:
                stream.write(bytes(4096))
        except OSError:
            return filler.unlink


def read_only(disk: Path, number: int) -> Callable[[], None]:
    """Cover the disk with one that cannot be written; healed by taking it off."""
    mount("-t", "tmpfs", "-o", "ro,size=4k", "tmpfs", str(disk))

    def heal() -> None:
        subprocess.run(["umount", str(disk)], check=True)

    return heal


def removed(disk: Path, number: int) -> Callable[[], None]:
    """Take the open segment, or now and then the whole folder, away; the recorder heals this by itself."""
    if number % 3 == 2:
        shutil.rmtree(disk / "run")
    else:
        (disk / "run" / "run.mcap").unlink()
    return lambda: None


def faults(root: Path, cycles: int) -> dict[str, object]:
    disk = root / "disk"
    disk.mkdir()
    mount("-t", "tmpfs", "-o", DISK, "tmpfs", str(disk))
    result: dict[str, object] = {}
    for fault in (full, read_only, removed):
        drive = Drive(disk / "run", RecordSettings(segment_s=2.0, keep_free_gb=0.0))
        troubles = set()
        for number in range(cycles):
            drive.go_on(30)
            heal = fault(disk, number)
            troubles.add(drive.until_trouble(True, f"{fault.__name__} {number} was not noticed"))
            drive.go_on(10)
            heal()
            drive.until_trouble(False, f"{fault.__name__} {number} was not overcome")
        drive.go_on(10)
        drive.recorder.close()
        reader = RunReader(disk / "run")
        seqs = [recorded.tick.seq for recorded in reader.ticks()]
        result[fault.__name__] = {
            "ticks": drive.seq,
            "read": len(seqs),
            "told": sum(gap.ticks for gap in reader.gaps),
            "in_order": seqs == sorted(set(seqs)),
            "last": seqs[-1] == drive.seq - 1,
            "put_us_p99": float(np.percentile(drive.puts_s, 99)) * 1e6,
            "troubles": sorted(troubles),
            "truncated": reader.truncated,
        }
        shutil.rmtree(disk / "run")
    return result


def kills(root: Path, times: int) -> dict[str, object]:
    """Each time a recorder in a forked child is killed at a random moment between its start and 1.5 s later."""
    rng = np.random.default_rng(9)
    lost_s = []
    segments = 0
    for number in range(times):
        path = root / f"run-{number}"
        child = os.fork()
        if child == 0:
            drive_until_killed(path)
        delay_s = float(rng.uniform(0.05, 1.5))
        while not (path / "manifest.jsonl").exists():
            time.sleep(0.001)
        time.sleep(delay_s)
        os.kill(child, signal.SIGKILL)
        killed_ns = time.monotonic_ns()
        os.waitpid(child, 0)
        reader = RunReader(path)
        stamps_ns = [recorded.tick.stamp_ns for recorded in reader.ticks()]
        seqs = [recorded.tick.seq for recorded in RunReader(path).ticks()]
        if seqs != list(range(len(seqs))):
            raise AssertionError(f"kill {number}: ticks are missing in {seqs}")
        lost_s.append(min(delay_s, (killed_ns - stamps_ns[-1]) * 1e-9 if stamps_ns else delay_s))
        segments = max(segments, len(reader.folder.segment_paths()))
        shutil.rmtree(path)
    return {"kills": times, "lost_s_max": max(lost_s), "lost_s_p50": float(np.median(lost_s)), "segments": segments}


def drive_until_killed(path: Path) -> None:
    rng = np.random.default_rng(1)
    header = RunHeader.of_live_run("seed = 1\n", {})
    recorder = Recorder(RunFolder.create(path, path), header, RecordSettings(segment_s=0.5))
    base = make_tick(0, rng, "scan", 200)
    estimate = make_estimate(0, rng, 200)
    for seq in range(100_000):
        now_ns = time.monotonic_ns()
        tick = type(base)(seq, now_ns, base.scan, base.wheels, base.events)
        recorder.put(CompletedTick(tick, estimate, make_timing(seq), bytes(16), None))
        time.sleep(0.01)
    os._exit(0)


def main() -> None:
    what, root, count = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3])
    json.dump({"faults": faults, "kills": kills}[what](root, count), sys.stdout)


if __name__ == "__main__":
    main()
