"""A wheel that sends only its speed: integrated to a total, so that it looks like a counter."""

from collections import Counter

from drivers.settings.encoders import EncoderSettings
from drivers.wheels.leaky_bucket import LeakyBucket
from drivers.wheels.readings import WheelReading


class SpeedIntegrator:
    """Same face as WheelCounter. Motion during a gap is unknown: speeds say nothing of frames that are missing."""

    def __init__(self, settings: EncoderSettings, sign: int) -> None:
        self.total = 0.0
        self.epoch = 0
        self.stamp_ns: int | None = None
        self.points: list[tuple[int, float, int]] = []
        self.counters: Counter[str] = Counter()
        self.speed_mps = 0.0
        self.frozen = LeakyBucket(5)
        self.two_senders = False
        self._period_ns = settings.period_ns
        self._longest_ns = settings.degraded_ns
        self._top_counts_per_s = settings.vehicle.jump_speed_mps * settings.counts_per_metre
        self._counts_per_metre = settings.counts_per_metre
        self._sign = sign
        self._speed = 0.0
        self._broken = True

    def restart(self) -> None:
        """Motion until the next frame is unknown."""
        self._broken = True

    def update(self, stamp_ns: int, reading: WheelReading) -> str | None:
        """Take one frame; None: accepted, else the reason for refusing it."""
        speed = reading.signed_speed or 0.0
        reason = None
        if not reading.status_ok:
            self.restart()
            reason = "status"
        elif reading.direction == 0 and speed != 0.0:
            self.restart()
            reason = "direction"
        elif abs(speed) > self._top_counts_per_s:
            reason = "jump"
        elif self.stamp_ns is not None and stamp_ns <= self.stamp_ns:
            reason = "out_of_order"
        if reason is not None:
            self.counters[reason] += 1
            return reason
        self._integrate(stamp_ns, self._sign * speed)
        return None

    def _integrate(self, stamp_ns: int, speed: float) -> None:
        """Trapezoidal rule from the last frame to this one."""
        if self.stamp_ns is not None:
            elapsed_ns = stamp_ns - self.stamp_ns
            if elapsed_ns > 1.5 * self._period_ns:
                self.counters["lost"] += round(elapsed_ns / self._period_ns) - 1
            if self._broken or elapsed_ns > self._longest_ns:
                self.epoch += 1
                self.counters["gap"] += 1
            else:
                self.total += 0.5 * (self._speed + speed) * elapsed_ns * 1e-9
        self._broken, self._speed = False, speed
        self.speed_mps = speed / self._counts_per_metre
        self.stamp_ns = stamp_ns
        self.points.append((stamp_ns, self.total, self.epoch))
