"""Scan messages of a stream to Scans: decoded, checked, stamped; whatever is wrong is counted by its reason."""

from collections import deque

import numpy as np

from drivers.events import EventLog
from drivers.laser.clock import LaserClock
from drivers.laser.timing.counter import CounterStatus
from drivers.measurements import FloatArray, RangeArray, Scan, uniform_bearings
from drivers.scip.codec import OK, ChecksumError, FramingError, ScanSizeError, StatusError, is_transient
from drivers.scip.commands import ScanRequest
from drivers.scip.framing import RawMessage
from drivers.scip.model import Parameters, range_code_meaning
from drivers.scip.scan import CodeArray, ScanData, ScanDecoder
from drivers.settings.laser import LaserSettings

FROZEN_SCANS = 10  # in a row with the very same ranges: a frozen sensor; real ranges differ by millimetres
MILLIMETRES = np.float32(1000.0)  # float32 holds every range in millimetres, so that rounding gives it back
SHORT_RANGE_MM = 4094  # MS saturates one above
LATE_NS = 100_000_000
FUTURE_NS = 2_000_000
FROZEN_BEAMS = 50  # so many valid ranges cannot repeat to the millimetre by chance
USELESS_STAMPS = 4  # that stand still or jump: twice away and back, and the stream has been asked for anew as often
FORGIVING_SCANS = 100  # with good stamps in a row, after which those before count no more
RATE_SCANS = 11
SLOW_SHARE = 0.75


class ScanAssembly:
    """One stream's messages in, Scans out; no link and no thread. `clock` outlives the stream.

    rate_hz: scans per second over the last ten; last_stamp_ns: of the newest scan; clock_restarted: set when the
    laser's clock began anew, for the owner to reset.
    """

    def __init__(
        self,
        settings: LaserSettings,
        parameters: Parameters,
        request: ScanRequest,
        clock: LaserClock,
        events: EventLog,
        range_codes: dict[str, int],
    ) -> None:
        self._settings = settings
        self._parameters = parameters
        self.expect(request)
        self._clock = clock
        self._events = events
        self._range_codes = range_codes
        cluster = request.cluster
        middle_step = request.first_step + (cluster - 1) / 2.0  # a cluster looks where its middle looks
        self._bearings: FloatArray = uniform_bearings(
            parameters.bearing_rad(middle_step), cluster * parameters.step_rad, request.beams
        )
        self._beam_period_s = cluster * parameters.step_period_s
        turned = (
            middle_step / parameters.steps_per_turn
            if settings.stamp_reference == "step_zero"
            else 0.5 + (middle_step - parameters.front_step) / parameters.steps_per_turn
        )
        self._first_beam_ns = round((turned * parameters.period_s + settings.stamp_offset_s) * 1e9)
        # at best a scan is sent when its last step has been measured
        self._nominal_delay_ns = parameters.last_step * parameters.step_period_s * 1e9
        self._range_max_mm = parameters.range_max_mm
        if request.range_characters == 2:
            self._range_max_mm = min(self._range_max_mm, SHORT_RANGE_MM)
        self.period_s = parameters.period_s * (request.interval + 1)
        self._arrivals: deque[int] = deque(maxlen=RATE_SCANS)
        self._last_codes: CodeArray | None = None
        self._repeats = 0
        self._damaged = self._useless_stamps = self._good_stamps = 0
        self._is_slow = False
        self.rate_hz = 0.0
        self.last_stamp_ns: int | None = None
        self.clock_restarted = False

    @property
    def nominal_delay_ns(self) -> float:
        """From the stamp of a scan to its arrival, where nothing better is known."""
        return self._nominal_delay_ns

    def expect(self, request: ScanRequest) -> None:
        """Decode the answers to this request from now on: of the same beams, with stamps of any resolution."""
        self._decoder = ScanDecoder(request, self._settings.echo)
        self._echo_head = request.encode()[:-2]

    def continue_from(self, before: "ScanAssembly") -> None:
        """Keep what outlives a connection: the newest stamp, and the ranges that a frozen sensor would repeat."""
        self.last_stamp_ns = before.last_stamp_ns
        self._last_codes, self._repeats = before._last_codes, before._repeats

    def take(self, raw: RawMessage) -> Scan | None:
        """The scan in a message; None where there is none to use, which is counted.

        Raises StatusError where the laser itself says why, ScanSizeError for a scan of another request.
        """
        try:
            data = self._decode(raw.data)
        except ChecksumError as error:
            self._note_damage(raw, "checksum_errors", str(error))
            return None
        except ScanSizeError as error:
            self._events.add(raw.stamp_ns, "wrong_size", str(error))
            raise
        except FramingError as error:
            self._note_damage(raw, "framing_errors", str(error))
            return None
        except StatusError as error:
            if error.status == OK:
                return None  # the stream's own acknowledgement, late
            if is_transient(error.status):
                self._events.add(raw.stamp_ns, f"status_{error.status}", str(error))
                return None
            raise
        if self._damaged:
            self._events.count("resynchronisations")
            self._damaged = 0
        return self._assemble(raw.stamp_ns, data)

    def _decode(self, raw: bytes) -> ScanData:
        """A scan, also one behind the head of a torn message."""
        start = raw.rfind(self._echo_head)
        if start > 0:
            self._damaged += 1
            self._events.count("torn_messages")
            raw = raw[start:]
        return self._decoder.decode(raw)

    def _note_damage(self, raw: RawMessage, kind: str, reason: str) -> None:
        self._damaged += 1
        self._events.add(raw.stamp_ns, kind, f"scan dropped: {reason}")

    def _assemble(self, arrival_ns: int, data: ScanData) -> Scan | None:
        has_clock = self._useless_stamps < USELESS_STAMPS
        if (has_clock and not self._observe(arrival_ns, data)) or self._is_frozen(arrival_ns, data.codes):
            return None
        stamp_ns = self._clock_stamp_ns(arrival_ns) if has_clock else self._arrival_stamp_ns(arrival_ns)
        if self.last_stamp_ns is not None and stamp_ns <= self.last_stamp_ns:
            self._events.add(arrival_ns, "out_of_order", "scan dropped: older than the one before")
            return None
        self._check_rate(arrival_ns, stamp_ns)
        self.last_stamp_ns = stamp_ns
        ranges_m = self._ranges(data.codes)
        range_max_m = self._range_max_mm / 1000.0
        return Scan(stamp_ns, ranges_m, self._bearings, self._beam_period_s, range_max_m=range_max_m)

    def _observe(self, arrival_ns: int, data: ScanData) -> bool:
        """Tell the clock of a stamp; False where it is that of the scan before."""
        reading = self._clock.observe(data.counter_ms, arrival_ns, self._nominal_delay_ns, data.time.fraction_us)
        self._count_useless(arrival_ns, reading is CounterStatus.GOOD)
        if reading is CounterStatus.STALE:
            self._events.add(arrival_ns, "stale_stamp", "scan dropped: it has the same stamp as the one before")
        elif reading is CounterStatus.RESTARTED:
            self.clock_restarted = True
            self._events.add(arrival_ns, "clock_restarts", "the laser's clock restarted from zero")
        return reading is not CounterStatus.STALE

    def _count_useless(self, arrival_ns: int, is_good: bool) -> None:
        """Give the stamps up, for this connection, where too many of them are not those of a clock."""
        self._good_stamps = self._good_stamps + 1 if is_good else 0
        self._useless_stamps = 0 if self._good_stamps >= FORGIVING_SCANS else self._useless_stamps + (not is_good)
        if not is_good and self._useless_stamps == USELESS_STAMPS:
            text = "the stamps of the laser's scans stand still or jump; the time of arrival is used from now on"
            self._events.add(arrival_ns, "useless_stamps", text)

    def _clock_stamp_ns(self, arrival_ns: int) -> int:
        """Of the first beam, by the laser's clock."""
        lateness_ns = self._clock.lateness_ns(arrival_ns)
        if lateness_ns > LATE_NS:
            text = f"scan late: {lateness_ns * 1e-6:.0f} ms more than the fastest"
            self._events.add(arrival_ns, "late_scans", text)
        stamp_ns = self._clock.stamp_ns() + self._first_beam_ns
        if stamp_ns <= arrival_ns + FUTURE_NS:
            return stamp_ns
        text = (
            "a stamp is in the future, so the time of arrival is used; the laser's clock or "
            "laser.stamp_reference is wrong"
        )
        self._events.add(arrival_ns, "future_stamps", text)
        return self._arrival_stamp_ns(arrival_ns)

    def _arrival_stamp_ns(self, arrival_ns: int) -> int:
        """Of the first beam, by when the scan came and the delay that its model has at best."""
        if self.last_stamp_ns is not None and self.last_stamp_ns > arrival_ns:
            self.last_stamp_ns = None  # that one was in the future
        return min(round(arrival_ns - self._nominal_delay_ns) + self._first_beam_ns, arrival_ns)

    def _ranges(self, codes: CodeArray) -> RangeArray:
        """Metres, NaN where there is only a code; codes are counted by meaning."""
        ranges_m: RangeArray = codes.astype(np.float32) / MILLIMETRES
        absent = (codes < self._parameters.range_min_mm) | (codes > self._range_max_mm)
        if absent.any():
            ranges_m[absent] = np.nan
            absent_codes = np.minimum(codes[absent], self._parameters.range_max_mm + 1)
            for code, beams in zip(*np.unique(absent_codes, return_counts=True), strict=True):
                meaning = "no_range_" + range_code_meaning(self._parameters, int(code))
                self._range_codes[meaning] = self._range_codes.get(meaning, 0) + int(beams)
        return ranges_m

    def _is_frozen(self, arrival_ns: int, codes: CodeArray) -> bool:
        """True if the very same ranges came too often in a row; a real sensor's differ by millimetres."""
        last, self._last_codes = self._last_codes, codes
        if last is None or not np.array_equal(last, codes):
            self._repeats = 0
            return False
        if np.count_nonzero(codes >= self._parameters.range_min_mm) < FROZEN_BEAMS:
            return False
        self._repeats += 1
        if self._repeats < FROZEN_SCANS:
            return False
        text = f"scan dropped: ranges frozen for {self._repeats} scans"
        self._events.add(arrival_ns, "frozen_scans", text)
        return True

    def _check_rate(self, arrival_ns: int, stamp_ns: int) -> None:
        """Scans that are missing by their stamps, and a rate that is too low for long."""
        if self.last_stamp_ns is not None:
            missed = round((stamp_ns - self.last_stamp_ns) * 1e-9 / self.period_s) - 1
            if missed > 0:
                text = f"{missed} scan(s) missing before this one"
                self._events.add(arrival_ns, "dropped_scans", text, amount=missed)
        self._arrivals.append(arrival_ns)
        span_ns = self._arrivals[-1] - self._arrivals[0]
        if span_ns > 0:  # two scans that came in one read arrived at the same time
            self.rate_hz = (len(self._arrivals) - 1) * 1e9 / span_ns
        was_slow = self._is_slow
        self._is_slow = len(self._arrivals) == RATE_SCANS and self.rate_hz * self.period_s < SLOW_SHARE
        if self._is_slow and not was_slow:
            text = f"the laser is slow: {self.rate_hz:.1f} scans per second, {1.0 / self.period_s:.1f} expected"
            self._events.add(arrival_ns, "slow", text)
