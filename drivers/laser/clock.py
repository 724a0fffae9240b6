"""The laser's clock seen from the host: 24-bit counter unwrapped, offset and drift estimated, wraps and restarts.

Three sources, from rough to fine: a nominal delay between measuring and arriving; the request for the device's time
(TM), whose answers bracket the offset; and the lower envelope of the arrival delay in the stream, whose slope is the
drift (see drift.py). A delay that changes for good moves neither the stamps nor the drift: the fastest messages of
eight seconds tell how much it was. Nothing here looks at a clock.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

from drivers.laser.timing.counter import NS_PER_MS, CounterStatus, CounterUnwrap
from drivers.laser.timing.delay_steps import BUCKET_NS, DelaySteps
from drivers.laser.timing.drift import HALF_MS_NS, POINTS_MIN, fastest_slope, slowest_slope, weigh

BUCKETS = 600  # five minutes: a crystal's drift changes with temperature, not faster
NS_PER_US = 1000
ANCHOR_LATE_NS = 50_000_000  # by so much the first scan after TM may be later than usual
BUSY_LATE_NS, BUSY_SCANS = 1_000_000_000, 3  # so much later a busy host may get it, but not so many in a row
ANCHOR_SPAN_NS = 120_000_000_000  # as long the offset hangs on the answers to TM
AGREEING_SIGMAS = 2.0
SLOWEST_SPAN_NS = 60_000_000_000
DRIFT_PRIOR_PPM = 50.0  # crystals are below 100
DELAY_STEP_NS = 2_000_000  # no crystal moves so far between two fits; the delay of the link has changed


Answer = tuple[int, int, int, *tuple[int, ...]]


@dataclass(frozen=True, slots=True)
class Envelope:
    """Lower envelope of arrival minus device time: level_ns at device time at_ns, slope without unit."""

    at_ns: int
    level_ns: float
    slope: float


class LaserClock:
    """Host time of device stamps.

    delay_ns: from the stamp to the arrival of a scan's first byte at best; drift_ppm: positive where the host's clock
    is the faster one; misfits: answers to TM in a row that were of another clock than the scan after them.
    """

    def __init__(self, drift_max_ppm: float) -> None:
        self._drift_max = drift_max_ppm * 1e-6
        self._unwrap = CounterUnwrap()
        self._lowest: deque[tuple[int, int]] = deque(maxlen=BUCKETS)
        self._highest: deque[tuple[int, int]] = deque(maxlen=BUCKETS)
        self._bucket = -1
        self._steps = DelaySteps()
        self._drift = 0.0
        self._drift_sigma = DRIFT_PRIOR_PPM * 1e-6
        self._prior = (self._drift, self._drift_sigma)
        self._anchor: tuple[int, float] | None = None
        self._unchecked_scans, self._expected_delay_ns = 0, 0.0
        self._envelope: Envelope | None = None
        self.misfits = 0
        self.delay_ns = 0.0
        self.bracket_ns = math.inf
        self._scatter_ns = math.inf
        self._half_ns = HALF_MS_NS

    @property
    def is_anchored(self) -> bool:
        """Whether the delay was measured by TM and not assumed."""
        return self._anchor is not None

    @property
    def delay_steps(self) -> int:
        """How often the delay has changed for good."""
        return self._steps.count

    @property
    def wraps(self) -> int:
        """How often the counter went through zero by itself."""
        return self._unwrap.wraps

    @property
    def drift_ppm(self) -> float:
        """Estimated drift."""
        return self._drift * 1e6

    @property
    def drift_uncertainty_ppm(self) -> float:
        """Standard deviation of the drift, from the scatter of the envelope and the time it spans."""
        return self._drift_sigma * 1e6

    @property
    def offset_ms(self) -> float:
        """Host time minus device time at the newest stamp; 0 before the first."""
        return 0.0 if self._envelope is None else (self._envelope.level_ns - self.delay_ns) / NS_PER_MS

    @property
    def offset_uncertainty_ms(self) -> float:
        """Half of the TM bracket (without TM: of the delay that was assumed), half a count of the device's clock, and
        twice what the drift and the steps of the delay since then may have added.

        Right after the start the drift is not known: up to 1.5 ms are reported after ten seconds, though the error is
        below one. In simulated jitter the error was within this for 94 to 100 % of the time.
        """
        if self._envelope is None:
            return math.inf
        half_ns = self.delay_ns / 2.0 if self._anchor is None else self.bracket_ns
        since_ns = 0 if self._anchor is None else self._envelope.at_ns - self._anchor[0]
        drift_ns = min(since_ns * self._drift_sigma, self._scatter_ns)
        further_ns = 2.0 * math.hypot(drift_ns, self._steps.sigma_ns)
        return (half_ns + self._half_ns + further_ns) / NS_PER_MS

    def synchronise(
        self, answers: Sequence[tuple[int, int, int, *tuple[int, ...]]], nominal_delay_ns: float
    ) -> CounterStatus:
        """Anchor the offset on answers to TM1: (host ns before, host ns after, counter ms), oldest first; with the
        microseconds beyond behind that, where the device tells them.

        Without answers the nominal delay from stamp to arrival is assumed. The envelope so far is kept if the
        device has not restarted.
        """
        self.bracket_ns = math.inf
        if not answers:
            self._anchor = None
            if self._envelope is None:
                self.delay_ns = nominal_delay_ns
            return CounterStatus.GOOD
        reading = CounterStatus.GOOD
        low, high, at_ns = -math.inf, math.inf, 0
        for before_ns, after_ns, counter_ms, *fraction_us in answers:
            if self._unwrap.take(counter_ms, after_ns, is_query=True) is CounterStatus.RESTARTED:
                reading = CounterStatus.RESTARTED
            at_ns = self._unwrap.total_ms * NS_PER_MS + sum(fraction_us) * NS_PER_US
            self._half_ns = 0 if fraction_us else HALF_MS_NS
            narrow_low, narrow_high = before_ns - at_ns - 2 * self._half_ns, after_ns - at_ns
            if max(low, narrow_low) > min(high, narrow_high):  # a clock that jumps; the newest answer counts
                low, high = narrow_low, narrow_high
            low, high = max(low, narrow_low), min(high, narrow_high)
        if reading is CounterStatus.RESTARTED:
            self._restart()
        self._steps.forget()
        self._anchor = (at_ns, (low + high) / 2.0)
        self._unchecked_scans = 1 if reading is CounterStatus.RESTARTED else BUSY_SCANS
        self._expected_delay_ns = self.delay_ns if self.delay_ns > 0.0 else nominal_delay_ns + 4.0 * ANCHOR_LATE_NS
        self.bracket_ns = (high - low) / 2.0
        return reading

    def observe(
        self, counter_ms: int, arrival_ns: int, nominal_delay_ns: float, fraction_us: int | None = None
    ) -> CounterStatus:
        """Take the stamp of a scan whose first byte arrived at a host time. fraction_us: beyond the milliseconds, None
        where the device does not tell it.
        """
        reading = self._unwrap.take(counter_ms, arrival_ns)
        if reading is CounterStatus.STALE:
            return reading
        if reading is CounterStatus.RESTARTED and self._anchor is not None and self._unchecked_scans:
            self._unchecked_scans, self.misfits = 0, self.misfits + 1  # right after TM: two clocks, if it does so again
        if reading is CounterStatus.GOOD and not self._fits_anchor(arrival_ns):
            reading, self.delay_ns = CounterStatus.RESTARTED, nominal_delay_ns
        if reading is CounterStatus.RESTARTED:
            self._restart()
            self._anchor = None
        if self._envelope is None and self._anchor is None and self.delay_ns == 0.0:
            self.delay_ns = nominal_delay_ns
        at_ns = self._unwrap.total_ms * NS_PER_MS + (fraction_us or 0) * NS_PER_US
        self._half_ns = HALF_MS_NS if fraction_us is None else 0
        point = (at_ns, arrival_ns - at_ns)
        bucket = at_ns // BUCKET_NS
        is_new = bucket != self._bucket or not self._lowest
        if is_new:
            self._bucket = bucket
            self._follow_delay()
            if not self._steps.is_pending:
                self._fit_drift()
        if self._steps.is_pending or (self._envelope and self._steps.is_too_early(self._above(point))):
            self._steps.set_aside(point)
            level_ns = self._level_at(at_ns)
        elif is_new or self._lowest[-1][0] // BUCKET_NS != bucket:
            self._lowest.append(point)
            self._highest.append(point)
            level_ns = min(y + self._drift * (at_ns - x) for x, y in self._lowest)
        else:
            if point[1] > self._highest[-1][1]:
                self._highest[-1] = point
            if point[1] < self._lowest[-1][1]:
                self._lowest[-1] = point
            level_ns = min(self._level_at(at_ns), point[1])
        self._set_envelope(Envelope(at_ns, level_ns, self._drift))
        return reading

    def stamp_ns(self) -> int:
        """Host time of the stamp that was observed last."""
        assert self._envelope is not None
        return round(self._envelope.level_ns - self.delay_ns) + self._envelope.at_ns + self._half_ns

    def lateness_ns(self, arrival_ns: int) -> float:
        """How much later than at best the newest scan arrived."""
        assert self._envelope is not None
        return arrival_ns - self._envelope.at_ns - self._envelope.level_ns

    def _fits_anchor(self, arrival_ns: int) -> bool:
        """False if the first scans after TM cannot be of the clock that answered: it began anew in between.

        A scan that is late only, as a busy host gets it, leaves that to the next: another clock is late each time.
        """
        if self._anchor is None or self._unchecked_scans == 0:
            return True
        self._unchecked_scans -= 1
        delay_ns = arrival_ns - self._unwrap.total_ms * NS_PER_MS - self._anchor[1]
        late_ns = delay_ns - self._expected_delay_ns
        is_early = delay_ns + DELAY_STEP_NS < 0
        if self._unchecked_scans and ANCHOR_LATE_NS <= late_ns < BUSY_LATE_NS:
            return True
        self._unchecked_scans = 0
        self.misfits = self.misfits + 1 if is_early or late_ns >= ANCHOR_LATE_NS else 0
        return self.misfits == 0

    def _restart(self) -> None:
        """The counter has begun anew; the crystal is the same, so the drift stays known."""
        self._lowest.clear()
        self._highest.clear()
        self._bucket = -1
        self._steps.restart()
        self._envelope = None
        self._prior = (self._drift, max(self._drift_sigma, 1e-6))

    def _fit_drift(self) -> None:
        """Slope of the fastest messages, weighed against what was known before and, at first, that of the slowest.

        The slowest take every change of the traffic for drift: they count only where they agree with the fastest.
        """
        drift, sigma = self._prior
        if len(self._lowest) >= POINTS_MIN:
            slope, slope_sigma, self._scatter_ns = fastest_slope(tuple(self._lowest), self._drift)
            if self._highest[-1][0] - self._highest[0][0] < SLOWEST_SPAN_NS:
                other, other_sigma = slowest_slope(self._highest, self._drift)
                if abs(other - slope) < AGREEING_SIGMAS * math.hypot(slope_sigma, other_sigma):
                    slope, slope_sigma = weigh(slope, slope_sigma, other, other_sigma)
            drift, sigma = weigh(drift, sigma, slope, slope_sigma)
        self._drift = max(-self._drift_max, min(self._drift_max, drift))
        self._drift_sigma = sigma

    def _follow_delay(self) -> None:
        """Once in a bucket: where the delay has changed for good, older points move with it, and so does the line."""
        if self._envelope is None:
            return
        found = self._steps.look(list(self._lowest), self._above, self._bucket)
        if isinstance(found, list):
            self._lowest.extend(found)
            self._highest.extend(found)
            return
        moved = [(x, y + round(found.step_ns)) for x, y in found.before] + found.after
        for points in (self._lowest, self._highest):
            points.clear()
            points.extend(moved)
        self.delay_ns += found.step_ns
        self._envelope = replace(self._envelope, level_ns=self._envelope.level_ns + found.step_ns)

    def _above(self, point: tuple[int, int]) -> float:
        return point[1] - self._level_at(point[0])

    def _level_at(self, at_ns: int) -> float:
        """The envelope drawn on to a device time."""
        assert self._envelope is not None
        return self._envelope.level_ns + self._envelope.slope * (at_ns - self._envelope.at_ns)

    def _set_envelope(self, envelope: Envelope) -> None:
        """Take the line of the estimated slope that touches the points from below, and tell what of it is delay."""
        before_ns = None if self._envelope is None else self._level_at(envelope.at_ns)
        self._envelope = envelope
        if self._anchor is None:
            return
        anchor_ns, offset_ns = self._anchor
        if envelope.at_ns - anchor_ns < ANCHOR_SPAN_NS:
            self.delay_ns = envelope.level_ns - (offset_ns + envelope.slope * (envelope.at_ns - anchor_ns))
        elif before_ns is not None and abs(envelope.level_ns - before_ns) > DELAY_STEP_NS:
            self.delay_ns += envelope.level_ns - before_ns
