"""Every fault that `infant sim` knows, typed at it while a rover drives with the real drivers, and what is said of it.

python -m tests.support.runtime.typed_trials [--jobs N] [--out DIR] [NAME...]

The devices are one process, `infant run` is another; between them are TCP and CAN frames. A trial is named right where
the first finding about sensors says both which component failed and why; a fault that does no harm may be left out.
"""

import argparse
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import IO

from drivers.canbus.loopback import free_port
from drivers.measurements import Severity
from runtime.report.build import examine
from runtime.report.finding import Finding
from tests.support.runtime.measured import VEHICLE
from tests.support.zenoh.wire import free_port as free_tcp_port

FAULT_S = 4.0
AFTER_LINES = 1  # of ticks, 10 s apart: enough for a fault of FAULT_S and for what the drivers say when it is over
PATIENCE_S = 120.0  # for an end on a busy machine
TRIALS = 3
OF_SENSORS = ("laser", "scan", "wheel", "odometry", "can_", "tread")
LEFT, RIGHT, BOTH = r"left wheel", r"right wheel", r"both wheel|wheel encoders|left and (the )?right"
LASER, BUS = r"laser|scan", r"\bbus\b"


@dataclass(frozen=True, slots=True)
class Typed:
    """A fault and what has to be said of it. sides: of the wheels that are tried, one a trial."""

    device: str
    fault: str
    cause: str
    component: str = ""
    lasts: bool = True
    harmless: bool = False
    sides: tuple[str, ...] = field(default=("left", "right", "both"))

    @property
    def name(self) -> str:
        """As the table has it."""
        return f"{self.device} {self.fault}"

    def line(self, trial: int) -> str:
        """What is typed."""
        words = [self.device, self.fault]
        if self.device == "wheels" and not self.component:
            words.append(f"wheel={self.sides[trial % len(self.sides)]}")
        if self.fault == "wrong_counts_per_rev":
            words.append("value=2048")
        if self.lasts:
            words.append(f"duration_s={FAULT_S:g}")
        return " ".join(words)

    def expected_component(self, trial: int) -> str:
        """Pattern of the component in the finding."""
        if self.component:
            return self.component
        return {"left": LEFT, "right": RIGHT, "both": BOTH}[self.sides[trial % len(self.sides)]]


def _laser(fault: str, cause: str, lasts: bool = True) -> Typed:
    return Typed("laser", fault, cause, LASER, lasts)


def _wheels(fault: str, cause: str, lasts: bool = True, harmless: bool = False) -> Typed:
    return Typed("wheels", fault, cause, lasts=lasts, harmless=harmless)


def _bus(fault: str, cause: str, lasts: bool = True, harmless: bool = False) -> Typed:
    return Typed("wheels", fault, cause, BUS, lasts, harmless)


TYPED = (
    _laser("off", "switched off|lost power"),
    _laser("stuck", "repeat"),
    _laser("garbage", "not SCIP"),
    _laser("wrong", "did not send"),
    _laser("slow", "skips sweeps|too slowly"),
    _laser("delayed", "late"),
    _laser("intermittent", "get lost|are lost"),
    _laser("cut", "connection broke"),
    _laser("power_cycle", "switched off and on|lost power", lasts=False),
    _laser("half_message", "incomplete"),
    _laser("bad_checksum", "damaged"),
    _laser("silence", "connected but sends nothing"),
    _laser("status", "fault|malfunction"),
    _laser("stale_stamp", "clock has stopped"),
    _laser("clock_reset", "reset its clock", lasts=False),
    _wheels("loss", "stopped sending.*(power|cable)"),
    _wheels("duplicate", "twice", harmless=True),
    _wheels("reorder", "out of order|order", harmless=True),
    _wheels("bad_crc", "damaged"),
    _wheels("bad_length", "length"),
    _wheels("remote", "requests frames|remote"),
    _wheels("fd", "CAN FD"),
    _wheels("extended", "29"),
    _wheels("alive_frozen", "hangs"),
    _wheels("second_sender", "two nodes"),
    _wheels("silence", "stopped sending.*(power|cable)"),
    _bus("silence_all", "stopped sending.*(power|broken)"),
    _wheels("status", "itself reports"),
    _wheels("stuck", "stuck"),
    _wheels("jump", "jumped", lasts=False),
    _wheels("power_cycle", "restarted"),
    _wheels("wrong_counts_per_rev", "counts per turn"),
    _bus("bus_off", "off"),
    _bus("error_passive", "error.passive"),
    _bus("error_warning", "error.warning"),
    _bus("error_flood", "bit rate|wiring"),
    _bus("burst", "flood|buffer", lasts=False, harmless=True),
)
BY_NAME = {typed.name: typed for typed in TYPED}


@dataclass(frozen=True, slots=True)
class Answer:
    """What the review said of one trial: kind and sentence of the first finding about sensors."""

    line: str
    kind: str
    sentence: str
    right: bool


def judged(typed: Typed, trial: int, findings: Sequence[Finding]) -> Answer:
    """Whether the first finding about sensors names component and cause."""
    about = [finding for finding in findings if finding.kind.startswith(OF_SENSORS)]
    told = [finding for finding in about if finding.severity is not Severity.INFO] or about
    if not told:
        return Answer(typed.line(trial), "", "nothing was found", typed.harmless)
    first = told[0]
    sentence = f"{first.title}: {first.cause}"
    wanted = (typed.cause, typed.expected_component(trial))
    said = all(re.search(pattern, sentence, re.IGNORECASE | re.DOTALL) for pattern in wanted)
    quiet = typed.harmless and first.severity is Severity.INFO
    return Answer(typed.line(trial), first.kind, sentence, said or quiet)


def drive(typed: Typed, trial: int, folder: Path) -> Path:
    """Drive 10 s, type the fault, drive 10 s more, however long a busy machine takes to start; the run's folder."""
    laser, bus, listen = free_tcp_port(), free_port(), free_tcp_port()
    mount = "[slam.mount]\nx_m = 0.3\n"
    encoders = f'[encoders.bus]\ninterface = "udp_multicast"\nport = {bus}\n'
    devices = folder / "devices.toml"
    devices.write_text(f"{encoders}[simulation.world]\nseed = {trial + 1}\n[simulation.laser]\nport = {laser}\n")
    rover = folder / "rover.toml"
    rover.write_text(
        f'rover = "trial"\nseed = {trial + 1}\n[laser]\nurl = "tcp://127.0.0.1:{laser}"\n{encoders}{mount}{VEHICLE}'
        f"[review]\nlive = false\n"
        f'[publish]\nconnect = []\nlisten = ["tcp/127.0.0.1:{listen}"]\n'
    )
    run = folder / "run"
    infant = [sys.executable, "-m", "runtime.cli"]
    with subprocess.Popen(
        [*infant, "sim", "--config", str(devices)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as sim:
        assert sim.stdin is not None
        assert sim.stdout is not None
        try:
            while "faults" not in (line := sim.stdout.readline()):
                if not line:
                    raise RuntimeError(f"{typed.name}: infant sim ended by itself")
            with subprocess.Popen(
                [*infant, "run", "--config", str(rover), "--out", str(run), "--json"],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            ) as driving:
                assert driving.stderr is not None
                _next_line_of_ticks(driving.stderr)
                sim.stdin.write(typed.line(trial) + "\n")
                sim.stdin.flush()
                for _ in range(AFTER_LINES):
                    _next_line_of_ticks(driving.stderr)
                driving.send_signal(signal.SIGINT)
                driving.stderr.read()
            if driving.returncode:
                raise RuntimeError(f"{typed.name}: infant run ended with code {driving.returncode}")
        finally:
            sim.send_signal(signal.SIGINT)
            sim.wait(PATIENCE_S)
    return run


def _next_line_of_ticks(said: IO[str]) -> None:
    """Wait for what the rover says every 10 s. Raises RuntimeError where it ends."""
    words = ""
    while not (line := said.readline()).startswith("tick"):
        if not line:
            raise RuntimeError(f"infant run ended before a line of ticks: {words.strip()}")
        words = line


def answer(name: str, trial: int, kept: Path | None = None) -> Answer:
    """One trial from start to judgement. kept: where runs stay that are to be looked at."""
    typed = BY_NAME[name]
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made) if kept is None else kept / f"{name.replace(' ', '_')}_{trial}"
        folder.mkdir(parents=True, exist_ok=True)
        run = folder / "run"
        if not run.exists():  # of an earlier call: only judged again
            try:
                run = drive(typed, trial, folder)
            except (
                RuntimeError
            ) as error:  # of a machine that is too busy; the other trials of the hour are worth having
                return Answer(typed.line(trial), "not driven", str(error), False)
        return judged(typed, trial, examine(run).findings)


def row(name: str, answers: Sequence[Answer]) -> str:
    """name | named right | what was said where it was not."""
    wrong = [
        f"'{each.line}' was called {each.kind or 'nothing'}: {each.sentence}" for each in answers if not each.right
    ]
    return f"| {name} | {sum(each.right for each in answers)} of {len(answers)} | {'; '.join(wrong) or '-'} |"


HEAD = "| typed | named right | what was said where not |\n|---|---|---|"


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the table to standard output, a row as soon as it is known."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=[*BY_NAME], metavar="NAME", help="as in the table, _ for a space")
    parser.add_argument("--jobs", type=int, default=2, help="rovers at a time")
    parser.add_argument("--trials", type=int, default=TRIALS, help="of each fault")
    parser.add_argument("--out", type=Path, help="keep the runs there; runs that are there already are judged again")
    options = parser.parse_args(arguments)
    names = [name.replace("_", " ", 1) if name not in BY_NAME else name for name in options.names]
    right = total = 0
    sys.stdout.write(HEAD + "\n")
    with ThreadPoolExecutor(options.jobs) as pool:
        asked = [
            [pool.submit(partial(answer, name, trial, options.out)) for trial in range(options.trials)]
            for name in names
        ]
        for name, futures in zip(names, asked, strict=True):
            answers = [future.result() for future in futures]
            right, total = right + sum(each.right for each in answers), total + len(answers)
            sys.stdout.write(row(name, answers) + "\n")
            sys.stdout.flush()
    sys.stdout.write(f"{right} of {total} named right\n")


if __name__ == "__main__":
    main()
