"""A person at a running `infant sim` can let something go wrong, and is told what was not understood."""

import io
import subprocess
import sys
import threading
from typing import get_args

import pytest
from pydantic import BaseModel

from drivers.settings.simulated_laser import FaultKind, LaserFault
from drivers.settings.simulated_wheels import WheelFault
from runtime.errors import UsageError
from runtime.simulation.typed_faults import obey, obey_lines
from runtime.source_tree import ROOT
from tests.support.drivers.waiting import wait_until


class Recorded:
    """Stands for a device and remembers what it was asked for."""

    def __init__(self) -> None:
        self.faults: list[BaseModel] = []

    def inject(self, fault: BaseModel) -> None:
        """As a device does."""
        self.faults.append(fault)

    def clear(self) -> None:
        """As a device does."""
        self.faults.clear()


def test_a_line_becomes_a_fault_of_the_device_and_clear_ends_it() -> None:
    laser, wheels = Recorded(), Recorded()
    devices = {"laser": laser, "wheels": wheels}
    obey("laser status status=60 duration_s=2", devices)
    obey("wheels loss wheel=both probability=0.5", devices)
    assert laser.faults == [LaserFault(kind=FaultKind.STATUS, status="60", duration_s=2.0)]
    assert wheels.faults == [WheelFault(kind="loss", wheel="both", probability=0.5)]
    obey("clear laser", devices)
    assert laser.faults == []


def test_what_was_typed_is_repeated_in_few_printable_characters() -> None:
    said: list[str] = []
    lines = io.StringIO("\x1b[2J\n" + "x" * 1_000_000 + "\nlaser a\x07=b\nhelp\n")
    obey_lines(lines, {"laser": Recorded()}, said.append, threading.Lock()).join(60.0)
    assert len(said) == 4
    assert all(line.isprintable() and len(line) < 5000 for sentence in said for line in sentence.split("\n"))


def test_nothing_is_answered_once_somebody_else_has_the_last_word() -> None:
    """A thread that wrote while the interpreter ended made `infant sim` end by SIGABRT."""
    laser, said, answering = Recorded(), list[str](), threading.Lock()
    answering.acquire()
    listening = obey_lines(io.StringIO("laser silence\n"), {"laser": laser}, said.append, answering)
    assert wait_until(lambda: laser.faults)
    assert said == []
    answering.release()
    listening.join(60.0)
    assert said == ["laser: silence"]


@pytest.mark.parametrize(
    ("line", "named"),
    [
        ("laser quiet", "kind='quiet': expected"),
        ("laser status status=98", "status='98': expected"),
        ("wheels loss often=1", "often='1': unknown key"),
        ("laser cut soon", "soon: expected KEY=VALUE"),
        ("camera cut", "camera: no such device"),
        ("clear", "clear: not understood"),
    ],
)
def test_a_line_that_cannot_be_obeyed_is_answered_by_one_sentence(line: str, named: str) -> None:
    with pytest.raises(UsageError, match=named):
        obey(line, {"laser": Recorded(), "wheels": Recorded()})


def test_help_lists_every_fault_and_its_parameters_with_defaults() -> None:
    text = obey("help", {"laser": Recorded(), "wheels": Recorded()})
    for fault in (*FaultKind, *get_args(WheelFault.model_fields["kind"].annotation)):
        assert f"{fault}" in text
    assert "    wheel=left  whose frames" in text
    assert "    duration_s=0.0  seconds until it ends by itself; 0: never" in text


def test_the_running_simulation_answers_lines_and_goes_on_after_a_wrong_one() -> None:
    command = [sys.executable, "-m", "runtime.cli", "sim", "--laser-only"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write("laser quiet\nlaser silence duration_s=0.1\n")
        process.stdin.flush()
        lines = [process.stdout.readline() for _ in range(4)]
        process.terminate()
    assert lines[0].startswith("laser  tcp://")
    assert "quiet" in lines[2]
    assert lines[3] == "laser: silence duration_s=0.1\n"
    assert process.returncode == 0
