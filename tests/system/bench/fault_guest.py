"""What runs inside the guest: faults of the table that need a kernel, one of them (BENCH_TASK) many times over.

A trial during which this process itself was not run for a while says nothing of the reader: it is repeated and counted.
"""

import ctypes
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.system.bench.can_guest import COUNTS_PER_METRE, LEFT_MPS, NODE, RIGHT_MPS, VCAN, Watch
from tests.system.bench.guest import load_modules, report, shell

TIMES = 100
MOST_VOID = 100
PAUSE_S = 0.15  # of this process, where it did not ask for it
SETTLE_S = 0.15
SMALL_BUFFER = 4096
LIBC = ctypes.PyDLL(None)  # calls keep the interpreter's lock: the reader's thread stands still with it


@dataclass(frozen=True, slots=True)
class Trial:
    """How one fault went."""

    counted: int
    recovery_s: float
    wrong_mm: float
    pause_s: float


class Trials:
    """One fault, again and again, on one reader."""

    def __init__(self, watch: Watch, counter: str) -> None:
        self.watch = watch
        self.counter = counter
        self._polled_s = 0.0
        self._pause_s = 0.0

    def run(self, begin: Callable[[], None], end: Callable[[], None], hold_s: float) -> Trial:
        """Begin, hold, end, and wait for good samples."""
        watch = self.watch
        before = watch.counters().get(self.counter, 0)
        mark = max(0, len(watch.samples) - 5)
        self._polled_s, self._pause_s = time.monotonic(), 0.0
        begin()
        began_s = self._polled_s = time.monotonic()
        watch.until(lambda: self._polled(time.monotonic() - began_s > hold_s))
        end()
        self._polled_s = time.monotonic()
        recovery_s = watch.until(lambda: self._polled(watch.fresh()), 5.0)
        settled_s = time.monotonic() + SETTLE_S
        watch.until(lambda: self._polled(time.monotonic() > settled_s))
        counted = watch.counters().get(self.counter, 0) - before
        return Trial(counted, recovery_s, self._wrong_mm(mark), self._pause_s)

    def _polled(self, answer: bool) -> bool:
        now_s = time.monotonic()
        self._pause_s = max(self._pause_s, now_s - self._polled_s)
        self._polled_s = now_s
        return answer

    def _wrong_mm(self, mark: int) -> float:
        """Largest change of a wheel's deviation from its course over this trial."""
        valid = [sample for sample in self.watch.samples[mark:] if sample.valid]
        worst = 0.0
        for name, speed in (("left", LEFT_MPS), ("right", RIGHT_MPS)):
            errors = [getattr(s, name) / COUNTS_PER_METRE - s.stamp_ns * 1e-9 * speed for s in valid]
            worst = max(worst, max(errors) - min(errors))
        return worst * 1000.0


def repeat(name: str, trials: Trials, begin: Callable[[], None], end: Callable[[], None], hold_s: float) -> None:
    """All trials of one fault, and what the worst was."""
    trials.watch.until(trials.watch.fresh, 30.0)
    done: list[Trial] = []
    void = 0
    while len(done) < TIMES and void < MOST_VOID:
        trial = trials.run(begin, end, hold_s)
        if trial.pause_s > PAUSE_S:
            void += 1
        else:
            done.append(trial)
    report(
        f"repeated {name}",
        trials=len(done),
        void=void,
        uncounted=sum(trial.counted < 1 for trial in done),
        recovery_s=max((trial.recovery_s if trial.recovery_s >= 0.0 else 1e9 for trial in done), default=-1.0),
        wrong_mm=max((trial.wrong_mm for trial in done), default=-1.0),
        counters=trials.watch.counters(),
    )


def nothing() -> None:
    """The fault ends by itself."""


def held_up(seconds: float) -> Callable[[], None]:
    """The reader is not run for so long, while frames go on arriving."""
    return lambda: LIBC.usleep(round(seconds * 1e6))


def main(root: Path, name: str) -> None:
    load_modules(root)
    make = "ip link add vcan0 type vcan && ip link set vcan0 up"
    shell(make)
    hours = [1.0]

    def jump() -> None:
        time.clock_settime(time.CLOCK_REALTIME, time.time() + 3600.0 * hours[0])
        hours[0] = -hours[0]

    down, up = "ip link set vcan0 down", "ip link set vcan0 up"
    faults: dict[str, tuple[str, Callable[[], None], Callable[[], None], float]] = {
        "clock": ("bus.clock_jump", jump, nothing, 0.05),
        "late": ("bus.late", held_up(0.3), nothing, 0.0),
        "down": ("bus.read", lambda: shell(down), lambda: shell(up), 0.3),
        "deleted": ("bus.read", lambda: shell("ip link del vcan0"), lambda: shell(make), 0.3),
        "overflow": ("bus.overflow", held_up(0.4), nothing, 0.45),
    }
    counter, begin, end, hold_s = faults[name]
    bus = VCAN.model_copy(update={"receive_buffer_bytes": SMALL_BUFFER}) if name == "overflow" else VCAN
    with subprocess.Popen([sys.executable, "-c", NODE], stdin=subprocess.PIPE) as node:
        watch = Watch(bus)
        repeat(name, Trials(watch, counter), begin, end, hold_s)
        watch.encoders.close()
        assert node.stdin is not None
        node.stdin.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), os.environ["BENCH_TASK"])
