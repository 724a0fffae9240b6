"""The laser is asked for its clock (SCIP's TM): when that is worth it, and when its answers are not."""

from collections.abc import Callable

from drivers.events import EventLog
from drivers.laser.client import ScipClient
from drivers.laser.clock import Answer, LaserClock
from drivers.laser.handshake import REPLY_TIMEOUT_S
from drivers.laser.timing.counter import CounterStatus
from drivers.measurements import Severity
from drivers.scip.codec import OK, ScipError, parse_device_time
from drivers.settings.laser import LaserSettings

TIME_SYNC_SAMPLES = 50  # TM1 requests; all brackets together count, and 50 take 30 ms on a network
TIME_SYNC_S = 1.0  # UST firmware answers TM slowly; a start must not hang on it
SECOND_TRY_NS = 15_000_000_000  # a laser that refuses TM while it boots has booted by then
ASKED_EVERY_NS = 180_000_000_000  # at most so often
MISFITS = 2  # answers in a row that fit no scan
EARLY_NS = 3_000_000  # of a delay: what its estimate may be off by
NO_CLOCK = "the laser does not report its clock (TM); stamps rely on the typical delay of its model"
OTHER_CLOCK = (
    "the clock that the laser reports (TM) is not that of its scans; it is no longer used, and stamps rely "
    "on the typical delay of the model"
)
IMPOSSIBLE = (
    "scans arrive {0:.1f} ms after their stamp, but a sweep takes {1:.1f} ms: the laser's clock (TM) is off, or "
    "laser.stamp_reference is wrong"
)
MICROSECOND_MODEL = "UST"  # of which firmware 4.1.0b knows %TM, %MD and %ME


class TimeAdjustment:
    """At the start of each stream, once more where the laser refused while it booted, and after the delay of the link
    has changed. in_microseconds: scans may be asked for with stamps of that resolution. advise: told in one sentence
    what is odd, by its kind; says each once.
    """

    def __init__(
        self,
        settings: LaserSettings,
        clock: LaserClock,
        now_ns: Callable[[], int],
        events: EventLog,
        advise: Callable[[str, str, Severity], None],
    ) -> None:
        self._settings, self._clock, self._now_ns = settings, clock, now_ns
        self._events, self._advise = events, advise
        self._is_wanted = settings.time_sync
        self._asked_ns: int | None = None
        self._refusals = 0
        self._steps = 0
        self._is_refused = False
        self.in_microseconds = False

    def expect(self, model: str) -> None:
        """Try for microseconds where the model may have them."""
        if MICROSECOND_MODEL in model and not self._is_refused:
            self.in_microseconds = True

    def refuse_microseconds(self) -> None:
        """The laser answers % with TM and not with a scan: milliseconds have to do."""
        self._is_refused, self.in_microseconds = True, False

    def adjust(self, client: ScipClient, nominal_delay_ns: float) -> None:
        """Ask a laser in standby, and tell the clock. Raises LinkError."""
        if self._is_wanted and self._clock.misfits >= MISFITS:
            self._is_wanted = False
            self._advise("other_clock", OTHER_CLOCK, Severity.WARN)
        answers: list[Answer] = []
        if not self._is_wanted:
            self.in_microseconds = False
        if self._is_wanted:
            answers = ask_time(client, self._now_ns, b"%" if self.in_microseconds else b"")
            if not answers and self.in_microseconds:
                self.refuse_microseconds()
                answers = ask_time(client, self._now_ns)
            self._asked_ns, self._steps = self._now_ns(), self._clock.delay_steps
            self._refusals = 0 if answers else self._refusals + 1
            if not answers:
                self._advise("no_time_sync", NO_CLOCK, Severity.INFO)
        if self._clock.synchronise(answers, nominal_delay_ns) is CounterStatus.RESTARTED:
            self._events.add(self._now_ns(), "clock_restarts", "the laser's clock restarted from zero")

    def is_due(self) -> bool:
        """Whether to ask again is worth the scan or two that it costs."""
        if self._asked_ns is None or not self._is_wanted:
            return False
        since_ns = self._now_ns() - self._asked_ns
        if self._refusals:
            return self._refusals == 1 and since_ns > SECOND_TRY_NS
        return self._clock.delay_steps > self._steps and since_ns > ASKED_EVERY_NS

    def check_delay(self, sweep_ns: float) -> None:
        """Say it where scans arrive before the laser can have measured them."""
        delay_ns, is_zero = self._clock.delay_ns, self._settings.stamp_reference == "step_zero"
        if is_zero and self._clock.is_anchored and delay_ns < sweep_ns - EARLY_NS:
            self._advise("impossible_delay", IMPOSSIBLE.format(delay_ns * 1e-6, sweep_ns * 1e-6), Severity.WARN)


def ask_time(client: ScipClient, now_ns: Callable[[], int], mark: bytes = b"") -> list[Answer]:
    """Answers to TM1 as (host ns before, host ns after, counter ms); empty where the laser has no such mode.

    mark: b"%" for answers in microseconds, which then stand behind the milliseconds.
    """
    reply = client.ask(mark + b"TM0", REPLY_TIMEOUT_S)
    answers: list[Answer] = []
    if reply is not None and reply.status in (OK, "02"):
        until_ns = now_ns() + round(TIME_SYNC_S * 1e9)
        for _ in range(TIME_SYNC_SAMPLES):
            before_ns = now_ns()
            reply = client.ask(mark + b"TM1", REPLY_TIMEOUT_S)
            after_ns = now_ns()
            if reply is None or reply.status != OK or not reply.lines or after_ns > until_ns:
                break
            try:
                time = parse_device_time(reply.lines[0])
            except ScipError:
                continue  # one damaged answer of many
            fraction = () if time.fraction_us is None else (time.fraction_us,)
            answers.append((before_ns, after_ns, time.counter_ms, *fraction))
    client.ask(mark + b"TM2", REPLY_TIMEOUT_S)
    return answers
