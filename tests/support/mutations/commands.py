"""Commands of `infant` on files of others, many in one process, and whether one of them was hurt.

Hurt is: exit code 70 or none, more than 10 s of the processor, a thread that is left behind, more than 300 MB, and a
warning of a library, which tells the reader of a journal nothing.
"""

import contextlib
import io
import multiprocessing
import os
import re
import resource
import signal
import sys
import tempfile
import threading
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

from runtime.cli.__main__ import main

LONGEST_S = 10.0
WAITING_S = 300.0  # without using the processor, on a machine that does other things too
MOST_MB = 300.0
BATCH = 100  # files in one process
DEFECT = 70
HURTS = ("exit 70", "hang", "memory", "thread", "warning")
WARNING = re.compile(r".*\w+Warning: .*")
Words = list[str]
Make = Callable[[Random, Path], Words]
"""Writes a file, or several, into a folder and says with which command of infant it is tried."""


class TooLongError(BaseException):
    """A command that would not end; nothing of ours catches it."""


@dataclass(slots=True)
class Tally:
    """hurt: a sentence on each case, by what it was; most_mb: of any process. Seeds make a case again."""

    tried: int = 0
    codes: Counter[int] = field(default_factory=Counter)
    hurt: dict[str, list[str]] = field(default_factory=lambda: {name: [] for name in HURTS})
    most_mb: float = 0.0
    longest_s: float = 0.0

    def add(self, other: "Tally") -> None:
        self.tried += other.tried
        self.codes += other.codes
        for name, cases in other.hurt.items():
            self.hurt[name] += cases
        self.most_mb = max(self.most_mb, other.most_mb)
        self.longest_s = max(self.longest_s, other.longest_s)


def run_batches(make: Make, seeds: range) -> Iterator[Tally]:
    """Each batch in a process of its own, one after the other."""
    for first in range(seeds.start, seeds.stop, BATCH):
        batch = range(first, min(first + BATCH, seeds.stop))
        yield in_a_process(lambda tally, batch=batch: _batch(make, batch, tally), f"seeds {batch}")  # type: ignore[misc]


def in_a_process(work: Callable[[Tally], None], what: str) -> Tally:
    """Run it in a process that ends with it; one that is killed, or takes more memory than it may, is hurt."""
    answer: Any = multiprocessing.get_context("fork").SimpleQueue()
    child = multiprocessing.get_context("fork").Process(target=_in_child, args=(work, what, answer))
    child.start()
    while answer.empty():
        child.join(0.05)
        if not child.is_alive() and answer.empty():
            tally = Tally()
            tally.hurt["exit 70"].append(f"{what}: the process ended with {child.exitcode}")
            return tally
    told: Tally = answer.get()
    child.join()
    return told


def _in_child(work: Callable[[Tally], None], what: str, answer: Any) -> None:
    tally = Tally()
    work(tally)
    tally.most_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024e-6
    if tally.most_mb > MOST_MB:
        tally.hurt["memory"].append(f"{what}: {tally.most_mb:.0f} MB")
    answer.put(tally)
    sys.stdout.flush()
    os._exit(0)  # threads of libraries would keep it


def _batch(make: Make, batch: Sequence[int], tally: Tally) -> None:
    for seed in batch:
        with tempfile.TemporaryDirectory() as folder:
            _try(make, seed, Path(folder), tally)


def _try(make: Make, seed: int, folder: Path, tally: Tally) -> None:
    words = make(Random(seed), folder)
    before, case = set(threading.enumerate()), f"seed {seed}: infant {' '.join(words[:3])}"
    began_s, said = os.times(), io.StringIO()
    code = called(words, said)
    used_s = sum(os.times()[:2]) - sum(began_s[:2])
    tally.tried += 1
    tally.codes[code] += 1
    tally.longest_s = max(tally.longest_s, used_s)
    if code == DEFECT:
        tally.hurt["exit 70"].append(f"{case}: {' | '.join(said.getvalue().strip().splitlines()[-3:])}")
    if code == -1 or used_s > LONGEST_S:
        tally.hurt["hang"].append(f"{case}: {used_s:.0f} s {said.getvalue().strip()[-400:]}")
    if warning := WARNING.search(said.getvalue()):
        tally.hurt["warning"].append(f"{case}: {warning[0]}")
    left = [thread for thread in threading.enumerate() if thread not in before and not thread.daemon]
    if left:
        tally.hurt["thread"].append(f"{case}: {left} left behind")


def called(words: Words, said: io.StringIO) -> int:
    """The exit code of a command run here; -1 where it had to be ended. said: what it wrote."""

    def end(*_: object) -> None:
        raise TooLongError

    previous = {number: signal.signal(number, end) for number in (signal.SIGPROF, signal.SIGALRM)}
    signal.setitimer(signal.ITIMER_PROF, 2.0 * LONGEST_S)
    signal.setitimer(signal.ITIMER_REAL, WAITING_S)
    try:
        with (
            mock.patch.object(sys, "argv", ["infant", *words]),
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(said),
        ):
            main()
    except SystemExit as end_of_it:
        return end_of_it.code if isinstance(end_of_it.code, int) else 0
    except TooLongError:
        said.write("".join(traceback.format_exc()))
        return -1
    except BaseException:  # noqa: BLE001 whatever it is, a person would see a traceback
        said.write(traceback.format_exc())
        return DEFECT
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in previous.items():
            signal.signal(number, handler)
    return 0
