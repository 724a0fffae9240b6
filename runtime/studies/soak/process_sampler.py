"""What the process holds while it runs: memory, descriptors and threads, once in each minute of driving."""

import ctypes
import gc
import os
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.live.drawing_process import ReviewProcess
from runtime.service.memory import resident_mb
from runtime.tick import CompletedTick, SinkHealth

DESCRIPTORS, THREADS = Path("/proc/self/fd"), Path("/proc/self/task")
GARBAGE_BEATS = 5  # before the end: one of the last beats may be missed
LOOK_BEATS = 10
OTHERS_S = 0.09  # a tick of some milliseconds that misses a beat of 100 ms was kept waiting so long, if by others
SETTLED_SHARE = 0.1  # of the drive; by then every buffer has been filled once


@dataclass(frozen=True, slots=True)
class Sample:
    """driven_s: since the first tick; resident_mb: what the system gave; heap_mb: what malloc has handed out of it;
    blocks: small objects of Python; drawing_mb: resident in the drawing process, which is apart from the others;
    kept_waiting_s: time in which threads of the process could have worked and had no processor."""

    driven_s: float
    resident_mb: float
    heap_mb: float
    blocks: int
    descriptors: int
    threads: int
    drawing_mb: float
    landmarks: int
    kept_waiting_s: float


class ProcessSampler:
    """Sink that takes a sample every `every_s` of driving.

    drawing: its process is looked at too. garbage: objects at the end of the drive that only the collector could free,
    which the loop has switched off; None where the drive ended early. missed_by_itself: beats that were missed though
    the threads of the process had a processor whenever they could work. last_seq: number of the last beat.
    """

    def __init__(self, every_s: float, last_seq: int) -> None:
        self.garbage: int | None = None
        self.missed_by_itself = 0
        self._waited_s = kept_waiting_s()
        self._last_seq = last_seq
        self.samples: list[Sample] = []
        self.drawing: ReviewProcess | None = None
        self._every_ns = round(every_s * 1e9)
        self._first_ns = self._next_ns = -1

    def put(self, completed: CompletedTick) -> None:
        """One tick."""
        tick, estimate, timing = completed.tick, completed.estimate, completed.timing
        if self._first_ns < 0:
            self._first_ns = self._next_ns = tick.stamp_ns
        if timing.missed or tick.seq % LOOK_BEATS == 0:
            before_s, self._waited_s = self._waited_s, kept_waiting_s()
            if self._waited_s - before_s < OTHERS_S * timing.missed:
                self.missed_by_itself += timing.missed
        ends = self.garbage is None and tick.seq > self._last_seq - GARBAGE_BEATS
        if ends:
            self.garbage = gc.collect()
        elif tick.stamp_ns < self._next_ns:
            return
        self._next_ns += self._every_ns
        self.samples.append(
            Sample(
                (tick.stamp_ns - self._first_ns) * 1e-9,
                resident_mb(),
                heap_mb(),
                sys.getallocatedblocks(),
                descriptors(),
                sum(1 for _ in THREADS.iterdir()),
                resident_mb(self.drawing.pid) if self.drawing is not None else 0.0,
                int(estimate.counts.get("landmarks", 0)),
                kept_waiting_s(),
            )
        )

    def health(self) -> SinkHealth:
        """Keeps figures in memory only: never in trouble."""
        return SinkHealth(0, 0)

    def close(self) -> None:
        """Nothing to release."""


def descriptors() -> int:
    """Descriptors that this process has open."""
    return len(os.listdir(DESCRIPTORS)) - 1  # without the one that reads the folder


def open_files() -> Counter[str]:
    """What they lead to; sockets and pipes without their numbers, and without what zenoh keeps until the process ends.

    zenoh keeps the waits of its threads and a file of shared memory for each session, closed or not: eleven after one.
    """
    found: Counter[str] = Counter()
    for name in os.listdir(DESCRIPTORS):
        with suppress(FileNotFoundError):  # the one that reads the folder
            target = os.readlink(DESCRIPTORS / name)
            if not target.startswith("anon_inode:") and not target.endswith(".zenoh"):
                found[target.split(":[")[0]] += 1
    return found


def kept_waiting_s(pid: int | None = None) -> float:
    """Of all threads of a process, this one by default, since each began; 0 where no schedstat tells it."""
    waited_ns = 0
    for thread in THREADS.iterdir() if pid is None else Path(f"/proc/{pid}/task").iterdir():
        with suppress(OSError, IndexError, ValueError):  # a thread that has just ended; a kernel without the file
            waited_ns += int((thread / "schedstat").read_text().split()[1])
    return waited_ns * 1e-9


def settled(samples: list[Sample]) -> list[Sample]:
    """Those after the first tenth of the drive."""
    return [sample for sample in samples if sample.driven_s >= SETTLED_SHARE * samples[-1].driven_s]


def fitted_growth(samples: list[Sample], values: Sequence[float]) -> float:
    """Growth of a value over all samples: the median slope between any two of them (Theil, Sen) times their span."""
    times_s, held = np.array([sample.driven_s for sample in samples]), np.array(values, np.float64)
    first, second = np.triu_indices(len(samples), 1)
    if not first.size:
        return 0.0
    slopes = (held[second] - held[first]) / (times_s[second] - times_s[first])
    return float(np.median(slopes) * (times_s[-1] - times_s[0]))


class MallInfo(ctypes.Structure):
    """struct mallinfo2 of malloc.h (glibc 2.33)."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in (
            *("arena", "ordblks", "smblks", "hblks", "hblkhd"),
            *("usmblks", "fsmblks", "uordblks", "fordblks", "keepcost"),
        )
    ]


def heap_mb() -> float:
    """What malloc has handed out and not got back, in all its arenas; memory that it keeps free does not hide a leak.

    0 where the C library does not tell.
    """
    if TELL_HEAP is None:
        return 0.0
    told = TELL_HEAP()
    return float(told.uordblks + told.hblkhd) * 1e-6


TELL_HEAP = getattr(ctypes.CDLL(None), "mallinfo2", None)  # once: each CDLL is a cycle, and the collector is off
if TELL_HEAP is not None:
    TELL_HEAP.restype = MallInfo
