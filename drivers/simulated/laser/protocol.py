"""The simulated laser's side of the conversation: a command in, a reply and a new state out. No port, no thread."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from drivers.scip.codec import (
    DATA,
    OK,
    StatusError,
    encode_key_values,
    encode_legacy_message,
    encode_message,
    encode_time,
    is_fault,
    summed,
)
from drivers.scip.commands import SINGLE_COMMANDS, STREAM_COMMANDS, ScanRequest, check_string, parse_scan_request
from drivers.scip.scan import CodeArray, encode_scan
from drivers.simulated.laser.motor import LaserMotor
from drivers.simulated.laser.payload import scan_characters
from drivers.simulated.laser.profiles import LaserProfile

REBOOT_WITHIN_NS = 1_000_000_000  # the second RB counts within 1 s of the first (SCIP 2.0)
PARAMETER_CHARACTERS = {"TM": 1, "SS": 6, "CR": 2, "HS": 1}
COMMANDS = ("VV", "PP", "II", "BM", "QT", "RS", "RT", "%SL", "%ST", "TM", "SS", "CR", "HS")


class State(Enum):
    """States of the sensor, by the number that %ST tells."""

    STANDBY = "000"
    TIME = "002"
    SINGLE = "003"
    MULTI = "004"
    SLEEP = "005"
    ERROR = "900"


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """One turn as the device knows it: its counter, and codes (steps,) in millimetres from the first step on."""

    counter_ms: int
    codes: CodeArray


class LaserProtocol:
    """State between commands. `baud` is what SS asked for; `rebooting` is set by the second RB."""

    def __init__(self, profile: LaserProfile, motor: LaserMotor, latest_sweep: Callable[[], Sweep]) -> None:
        self._profile = profile
        self._motor = motor
        self._latest_sweep = latest_sweep
        self._reboot_requested_ns: int | None = None
        self._high_sensitivity = False
        self._slowdown = 0
        self.state = State.STANDBY
        self.legacy = profile.starts_in_scip1
        self.request: ScanRequest | None = None
        self.remaining = 0
        self.baud = 19200
        self.rebooting = False

    def disconnect(self) -> None:
        """The client has gone: no one to send scans to."""
        if self.state is State.MULTI:
            self._rest()

    def recover(self) -> None:
        """The malfunction is over."""
        if self.state is State.ERROR:
            self._rest()

    def fail(self) -> None:
        """A malfunction that only a reboot ends."""
        self.request, self.state = None, State.ERROR

    def reply(self, line: bytes, now_ns: int) -> bytes:
        """Answer to one command without its line end; b"" for an empty line."""
        line = line.strip(b"\r")
        if not line:
            return b""
        if self.legacy:
            return self._reply_legacy(line)
        text = line.decode("ascii", "replace")
        name = text[:3] if text[0] in "%$" else text[:2]
        try:
            return self._answer(name, text, line, now_ns)
        except StatusError as error:
            return encode_message(line, error.status)

    def scan(self, sweep: Sweep, missing_steps: int = 0) -> bytes:
        """The stream's message for a sweep; counts down, and ends the stream after its last.

        missing_steps: so many steps too few are sent, which a sound sensor never does.
        """
        assert self.request is not None
        request = self.request
        if request.count:
            self.remaining -= 1
        sent = replace(request, last_step=request.last_step - missing_steps)
        message = encode_scan(request.echo(self.remaining), DATA, sweep.counter_ms, self._characters(sent, sweep))
        if request.count and self.remaining == 0:
            self._rest()
        return message

    def status_in_stream(self, status: str) -> bytes:
        """A status in place of a scan; a malfunction ends the stream."""
        assert self.request is not None
        message = encode_message(self.request.echo(self.remaining), status)
        if is_fault(status):
            self.fail()
        return message

    def _reply_legacy(self, line: bytes) -> bytes:
        if line == b"SCIP2.0":
            self.legacy = False
            return encode_legacy_message(line, "0")
        if line == b"V":
            lines = tuple(f"{key}:{value};".encode() for key, value in self._profile.version.items())
            return encode_legacy_message(line, "0", lines)
        return encode_legacy_message(line, "E")

    def _answer(self, name: str, text: str, line: bytes, now_ns: int) -> bytes:
        if text == "SCIP2.0":
            return encode_message(line, "0E")
        if name == "RB":
            return encode_message(line, self._reboot(now_ns))
        if self.state is State.ERROR and name not in ("VV", "PP", "II", "%ST"):
            return encode_message(line, "0L")
        if name in STREAM_COMMANDS or name in SINGLE_COMMANDS:
            return self._measure(parse_scan_request(line), line)
        body, _, string = text.partition(";")
        check_string(name, ";" + string if string else "")
        wanted = len(name) + PARAMETER_CHARACTERS.get(name, 0)
        if name not in COMMANDS or (name == "%ST" and not self._profile.knows_state):
            raise StatusError(name, "0E")
        if len(body) != wanted:
            raise StatusError(name, "0C" if len(body) < wanted else "0D")
        parameter = body[len(name) :]
        match name:
            case "VV":
                return encode_message(line, OK, encode_key_values(self._profile.version))
            case "PP":
                return encode_message(line, OK, encode_key_values(self._profile.parameters.key_values()))
            case "II":
                return encode_message(line, OK, encode_key_values(self._information(now_ns)))
            case "%ST":
                return encode_message(line, OK, summed(self.state.value.encode()))
            case "TM":
                return self._adjust_time(line, parameter, now_ns)
            case "SS" | "CR" | "HS":
                return encode_message(line, self._configure(name, parameter, now_ns))
            case _:
                return encode_message(line, self._change_state(name, now_ns))

    def _information(self, now_ns: int) -> dict[str, str]:
        profile, speed = self._profile, self._profile.parameters.speed_rpm
        measuring = {State.SINGLE: profile.single, State.MULTI: profile.multi}.get(self.state, profile.idle)
        return {
            "MODL": profile.parameters.model,
            "LASR": "ON" if self.state in (State.SINGLE, State.MULTI) else "OFF",
            "SCSP": f"Initial({speed}[rpm])<-Default setting by user",
            "MESM": measuring,
            "SBPS": profile.link,
            "TIME": f"{self._motor.counter_ms(now_ns):06X}",
            "STAT": "Error 100 malfunction." if self.state is State.ERROR else profile.healthy,
        }

    def _change_state(self, name: str, now_ns: int) -> str:
        if self.state is State.TIME and name in ("BM", "QT", "%SL"):
            return "10"
        match name:
            case "BM":
                if self.state in (State.SINGLE, State.MULTI):
                    return "02"
                self.state = State.SINGLE
            case "%SL":
                if not self._profile.knows_state:
                    return "0E"
                self.request, self.state = None, State.SLEEP
            case _:
                self._rest()
                if name != "QT":
                    self._motor.reset_counter(now_ns)
        return OK

    def _adjust_time(self, line: bytes, code: str, now_ns: int) -> bytes:
        match code:
            case "0" if self.state is State.TIME:
                return encode_message(line, "02")
            case "0" if self.state in (State.MULTI, State.SLEEP):
                return encode_message(line, "10")
            case "0":
                self.state = State.TIME
                return encode_message(line, OK)
            case "1" if self.state is State.TIME:
                return encode_message(line, OK, encode_time(self._motor.counter_ms(now_ns)))
            case "1":
                return encode_message(line, "04")
            case "2" if self.state is State.TIME:
                self._rest()
                return encode_message(line, OK)
            case "2":
                return encode_message(line, "03")
        return encode_message(line, "01")

    def _configure(self, name: str, parameter: str, now_ns: int) -> str:
        if self.state is State.TIME:
            return "10"
        if name == "SS":
            if self._profile.ethernet:
                return "0F"
            if not self._profile.bauds:
                return "04"
            if not parameter.isdigit():
                return "01"
            if int(parameter) not in self._profile.bauds:
                return "02"
            before, self.baud = self.baud, int(parameter)
            return "03" if before == self.baud else OK
        if name == "CR":
            if not self._profile.motor_speeds:
                return "04"
            if not parameter.isdigit():
                return "01"
            slowdown = 0 if parameter == "99" else int(parameter)
            if slowdown > 10:
                return "02"
            if slowdown == self._slowdown:
                return "03"
            self._slowdown = slowdown
            self._motor.slow_down(slowdown, now_ns)
            return OK
        if not self._profile.high_sensitivity:
            return "0E"
        if parameter not in ("0", "1"):
            return "01"
        wanted = parameter == "1"
        if wanted == self._high_sensitivity:
            return "02"
        self._high_sensitivity = wanted
        return OK

    def _measure(self, request: ScanRequest, line: bytes) -> bytes:
        parameters = self._profile.parameters
        if (request.is_multi_echo and not self._profile.multi_echo) or (
            request.has_intensity and not self._profile.intensity
        ):
            raise StatusError(request.command, "0E")
        if self.state in (State.TIME, State.SLEEP):
            raise StatusError(request.command, "10")
        if not parameters.first_step <= request.first_step <= parameters.last_step:
            raise StatusError(request.command, "01")
        if request.last_step > parameters.last_step:
            raise StatusError(request.command, "04")
        if request.last_step < request.first_step:
            raise StatusError(request.command, "05")
        if request.is_stream:
            self.request, self.remaining, self.state = request, request.count, State.MULTI
            return encode_message(line, OK)
        if self.state is State.STANDBY:
            raise StatusError(request.command, "10")
        sweep = self._latest_sweep()
        return encode_scan(line, OK, sweep.counter_ms, self._characters(request, sweep))

    def _characters(self, request: ScanRequest, sweep: Sweep) -> bytes:
        first = self._profile.parameters.first_step
        codes = sweep.codes[request.first_step - first : request.last_step - first + 1]
        return scan_characters(request, np.ascontiguousarray(codes), self._profile.parameters.range_min_mm)

    def _reboot(self, now_ns: int) -> str:
        asked_ns, self._reboot_requested_ns = self._reboot_requested_ns, now_ns
        if asked_ns is None or now_ns - asked_ns > REBOOT_WITHIN_NS:
            return "01"
        self._rest()
        self.rebooting = True
        return OK

    def _rest(self) -> None:
        self.request, self.state = None, State.STANDBY
