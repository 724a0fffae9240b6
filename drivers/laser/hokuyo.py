"""The laser: connects, streams, notices what is wrong, and never gives up.

One thread reads; it waits in the kernel, and holds the interpreter for about 0.1 ms a scan. What the loop calls only
swaps references.
"""

import math
import threading
from collections.abc import Callable
from dataclasses import replace

from drivers.events import EventLog
from drivers.laser.around_errors import AroundErrors
from drivers.laser.client import ScipClient
from drivers.laser.clock import LaserClock
from drivers.laser.connect import LaserConnector
from drivers.laser.handshake import (
    REPLY_TIMEOUT_S,
    BootWait,
    Device,
    LaserFaultError,
    NoAnswerError,
    NotScipError,
    describe,
    enter_standby,
)
from drivers.laser.request import scan_request
from drivers.laser.scans import ScanAssembly
from drivers.laser.time_adjustment import TimeAdjustment
from drivers.measurements import (
    DriverError,
    Event,
    LinkError,
    RawTap,
    Scan,
    SensorHealth,
    SensorState,
    Severity,
)
from drivers.scip.codec import DATA, OK, ScanSizeError, StatusError, is_fault
from drivers.scip.commands import ScanRequest
from drivers.scip.model import KNOWN_MODELS
from drivers.settings.laser import LaserSettings
from drivers.stoppable_thread import StoppableThread

DRIFT_MAX_PPM = 200.0  # ppm, bound on the drift of the device's clock; crystals are below 100
STALE_AFTER_S = 0.35  # s without a scan until the state is stale; at least 3.5 periods are waited
SILENCE_S = 0.5  # s without a scan until the stream is asked for again; at least 3 periods
RETRY_MIN_S = 0.1  # s before the second attempt to connect; doubles
RETRY_MAX_S = 0.5  # s between attempts at most; small, because a scan is due 2 s after a repair
WAIT_S = 0.25  # longest wait in the kernel, so that closing is quick
STALE_PERIODS = 3.5
SILENT_PERIODS = 3.0
REBOOT = "it needs a reboot"


class Hokuyo:
    """A Laser (see measurements) that speaks SCIP over TCP or a serial port; one use: start() once, close() once."""

    def __init__(
        self,
        settings: LaserSettings,
        now_ns: Callable[[], int],
        tap: RawTap | None = None,
        alive: Callable[[], None] = lambda: None,
        raw_around_errors: bool = False,
    ) -> None:
        """raw_around_errors: hand the tap only the bytes of two seconds before and after each error. alive: called by
        the thread in each turn of its loop, at least every few seconds.
        """
        self._settings = settings
        self._now_ns = now_ns
        around = AroundErrors(tap) if tap is not None and raw_around_errors else None
        self._tap = around if around is not None else tap
        self._events = EventLog("laser", around.error if around is not None else None)
        self._clock = LaserClock(DRIFT_MAX_PPM)
        self._range_codes: dict[str, int] = {}
        self._thread = StoppableThread("laser", self._run, alive, self._note_defect)
        self._connector = LaserConnector(settings, self._tap, now_ns, self._thread.is_stopping, self._events)
        self._fresh: Scan | None = None
        self._lock = threading.Lock()
        self._last_scan_ns: int | None = None
        self._assembly: ScanAssembly | None = None
        self._device: Device | None = None
        self._fault = ""
        self._advice: dict[str, str] = {}  # what was reported once, by kind
        self._time = TimeAdjustment(settings, self._clock, now_ns, self._events, self._advise_once)
        self._boot = BootWait(now_ns)

    def start(self) -> None:
        """Begin to connect, in a thread of its own."""
        self._thread.start()

    def latest(self) -> Scan | None:
        """The newest scan that has not been handed out; an older one that nobody took is counted."""
        with self._lock:
            scan, self._fresh = self._fresh, None
        return scan

    def drain_events(self) -> tuple[Event, ...]:
        """Events since the last call."""
        return self._events.drain()

    def health(self) -> SensorHealth:
        """State now; its reason names the last trouble."""
        now_ns, last_ns, assembly, clock = self._now_ns(), self._last_scan_ns, self._assembly, self._clock
        trouble = self._events.trouble
        age_s = math.inf if last_ns is None else (now_ns - last_ns) * 1e-9
        period_s = assembly.period_s if assembly is not None else 1.0 / self._settings.rate_hz
        if age_s <= max(STALE_AFTER_S, STALE_PERIODS * period_s):
            state, reason = SensorState.FRESH, ""
        elif self._fault:
            state, reason = SensorState.FAILED, self._fault
        elif last_ns is None:
            state, reason = SensorState.STARTING, trouble or f"connecting to {self._settings.url}"
        else:
            state, reason = SensorState.STALE, f"no scan: {age_s:.1f} s since the last; {trouble}".removesuffix("; ")
        figures = {
            "period_s": period_s,
            "clock_offset_ms": clock.offset_ms,
            "clock_offset_uncertainty_ms": clock.offset_uncertainty_ms,
            "clock_drift_ppm": clock.drift_ppm,
            "clock_drift_uncertainty_ppm": clock.drift_uncertainty_ppm,
            "arrival_delay_ms": clock.delay_ns * 1e-6,
        }
        if last_ns is not None:
            figures["age_s"] = age_s
        fresh = state is SensorState.FRESH
        rate_hz = assembly.rate_hz if assembly is not None and fresh else 0.0
        counters = dict(self._events.counters) | dict(self._range_codes) | {"clock_wraps": clock.wraps}
        return SensorHealth(state, reason, rate_hz, counters, figures, self._facts())

    def close(self) -> None:
        """Stop the stream and the thread; at most 2 s."""
        self._thread.stop()

    def _facts(self) -> dict[str, str]:
        facts, device = {"url": self._settings.url}, self._device
        if device is not None:
            facts["model"] = device.parameters.model
            names = {"FIRM": "firmware", "SERI": "serial_number", "PROT": "protocol", "STAT": "state", "MESM": "mode"}
            reported = device.version | device.state
            facts |= {name: reported[key] for key, name in names.items() if key in reported}
        if self._advice:
            facts["advice"] = "; ".join(self._advice.values())
        return facts

    def _run(self) -> None:
        """Connect for ever, waiting longer after each failure in a row."""
        wait_s = RETRY_MIN_S
        while not self._thread.is_stopping():
            before_ns = self._last_scan_ns
            try:
                self._connect_and_run()
            except DriverError as error:
                if self._thread.was_stopped:
                    break
                self._note_failure(error)
            if self._last_scan_ns != before_ns:
                wait_s = RETRY_MIN_S
            if self._thread.wait(wait_s):
                break
            wait_s = min(2.0 * wait_s, RETRY_MAX_S)
            self._events.count("reconnects")

    def _note_defect(self, what: str) -> None:
        text = f"defect in the laser driver, reconnecting: {what}"
        self._events.add(self._now_ns(), "defects", text, Severity.ERROR)

    def _note_failure(self, error: DriverError) -> None:
        kinds = {
            LaserFaultError: "malfunctions",
            NotScipError: "not_scip",
            NoAnswerError: "no_answer",
            LinkError: "link_errors",
            StatusError: "refusals",
        }
        kind = next((kind for family, kind in kinds.items() if isinstance(error, family)), "bad_descriptions")
        self._fault = str(error) if isinstance(error, LaserFaultError) else ""
        severity = Severity.ERROR if self._fault else Severity.WARN
        self._events.add(self._now_ns(), kind, str(error), severity)

    def _connect_and_run(self) -> None:
        """One connection, from opening to whatever ends it. Raises DriverError."""
        connection = self._connector.connect()
        try:
            self._run_session(connection.client)
        except LaserFaultError:
            self._connector.reboot(connection.client)
            raise
        finally:
            if self._thread.was_stopped:
                connection.client.send(b"QT")  # laser and motor need not run for nobody
            connection.link.close()

    def _run_session(self, client: ScipClient) -> None:
        """Describe, adjust the clock, stream; a stream without a scan ends the connection. Raises DriverError."""
        device = describe(client, self._settings, self._boot)
        self._device = device
        self._note_connection(device)
        request, warnings = scan_request(self._settings, device.parameters)
        for kind, warning in warnings.items():
            self._advise_once(kind, warning, Severity.WARN)
        assembly = ScanAssembly(
            self._settings, device.parameters, request, self._clock, self._events, self._range_codes
        )
        if self._assembly is not None:
            assembly.continue_from(self._assembly)
        self._assembly = assembly
        self._time.expect(device.parameters.model)
        while True:
            self._time.adjust(client, assembly.nominal_delay_ns)
            request = replace(request, in_microseconds=self._time.in_microseconds)
            assembly.expect(request)
            self._request_stream(client, request)
            began_ns = self._now_ns()
            self._stream(client, assembly)
            if self._last_scan_ns is None or self._last_scan_ns < began_ns:
                if device.complaint:
                    raise LaserFaultError(f"the laser reports {device.complaint!r} and sends no scan; {REBOOT}")
                raise LinkError("the laser sends no usable scan, even when asked again")
            self._events.count("stream_restarts")
            enter_standby(client, self._settings, attempts=1, drain_first=False)

    def _request_stream(self, client: ScipClient, request: ScanRequest) -> None:
        reply = client.ask(request.encode(), REPLY_TIMEOUT_S)
        if request.in_microseconds and (reply is None or reply.status not in (OK, DATA)):
            self._time.refuse_microseconds()
        if reply is None:
            raise NoAnswerError(f"{self._settings.url} does not answer {request.command}")
        if is_fault(reply.status):
            raise LaserFaultError(f"the laser reports a malfunction (status {reply.status}); {REBOOT}")
        if reply.status not in (OK, DATA):
            if self._device is not None and self._device.complaint:
                raise LaserFaultError(f"the laser reports {self._device.complaint!r} and does not measure; {REBOOT}")
            raise StatusError(request.command, reply.status, "see laser.command and laser.cluster")

    def _stream(self, client: ScipClient, assembly: ScanAssembly) -> None:
        """Hand out scans until none comes for too long, or the stream has to be asked for again. Raises DriverError."""
        silence_ns = round(max(SILENCE_S, SILENT_PERIODS * assembly.period_s) * 1e9)
        alive_ns = self._now_ns()
        bytes_before = client.received_bytes
        while not self._thread.is_stopping():
            waited_ns = self._now_ns() - alive_ns
            if waited_ns >= silence_ns:
                self._note_silence(client.received_bytes > bytes_before, silence_ns)
                return
            for raw in client.receive(min(WAIT_S, (silence_ns - waited_ns) * 1e-9)):
                try:
                    scan = assembly.take(raw)
                except ScanSizeError:
                    return
                except StatusError as error:
                    if is_fault(error.status):
                        raise LaserFaultError(str(error)) from error
                    raise
                if scan is not None:
                    self._time.check_delay(assembly.nominal_delay_ns)
                    self._hand_out(scan, raw.stamp_ns)
                    alive_ns, bytes_before = raw.stamp_ns, client.received_bytes
            if assembly.clock_restarted:
                assembly.clock_restarted = False
                return
            if self._time.is_due():
                self._events.count("clock_checks")
                return

    def _note_silence(self, has_bytes: bool, silence_ns: int) -> None:
        kind = "garbage" if has_bytes else "silences"
        what = "only bytes that hold no usable scan" if has_bytes else "nothing"
        text = f"{what} came from the laser for {silence_ns * 1e-9:.1f} s; asking again"
        self._events.add(self._now_ns(), kind, text)

    def _hand_out(self, scan: Scan, arrival_ns: int) -> None:
        with self._lock:
            superseded, self._fresh = self._fresh, scan
        self._last_scan_ns = arrival_ns
        self._fault = self._events.trouble = ""
        self._events.count("scans")
        if superseded is not None:
            self._events.count("superseded_scans")

    def _note_connection(self, device: Device) -> None:
        model = device.parameters.model
        product = device.version.get("PROD", "")
        if not any(known in model or known in product for known in KNOWN_MODELS):
            text = f"laser model {model!r} is unknown; using what it reports about itself"
            self._advise_once("unknown_model", text, Severity.WARN)
        firmware = device.version.get("FIRM", "unknown")
        if device.complaint:
            text = f"the laser reports {device.complaint!r}; it is used as long as it measures; see its manual"
            self._advise_once("complaint", text, Severity.WARN)
        self._events.add(self._now_ns(), "connections", f"laser {model}, firmware {firmware}, found", Severity.INFO)
        self._events.trouble = ""

    def _advise_once(self, kind: str, text: str, severity: Severity) -> None:
        if kind not in self._advice:
            self._advice[kind] = text
            self._events.add(self._now_ns(), kind, text, severity)
