"""One wheel's counter: unwraps it and refuses what cannot be motion of that wheel.

Frames that fit the track so far are accepted. Frames that do not are kept as a second track: when it goes on
while the first one is silent, the node has restarted or its count has moved, and the total goes on from there
without the step; when both go on, two nodes send under one id.
"""

from collections import Counter
from dataclasses import dataclass

from drivers.settings.encoders import EncoderSettings
from drivers.wheels.alive_counter import AliveCounter
from drivers.wheels.leaky_bucket import LeakyBucket
from drivers.wheels.readings import WheelReading

SLACK_COUNTS = 4.0  # quantisation of two readings, and dither at rest
SPEED_STEPS = 3  # the last speed says nothing of more frames than this
RESIDUAL_KEPT = 0.96  # per frame: half a second at 50 Hz
CONFIRMATIONS = 2  # frames of the second track, the first one included, before the total follows it
STALE_CONFIRMATIONS = 5  # the same where they bear the boot id of before: late frames come at most 3 late
SENDERS_SURE = 4  # interleaved frames of a second track: late frames before a restart are at most 3
SENDERS_FORGOTTEN = 15  # frames of the first track alone, after which there is one sender again
SILENT_PERIODS = 10.0  # after so long a node may have been off, whether or not it says so


@dataclass(slots=True)
class Track:
    """Last frame of one sequence of frames that belong together. gained: counts since its first frame."""

    stamp_ns: int
    reading: WheelReading
    confirmed: int = 1
    gained: float = 0.0


class WheelCounter:
    """Total of one wheel in counts, forward positive, starting at 0.

    `epoch` counts the breaks over which motion is unknown: totals of two epochs must not be subtracted.
    `points` collects (stamp_ns, total, epoch) of accepted frames until they are taken.
    """

    def __init__(self, settings: EncoderSettings, sign: int, modulus: float, alive_modulus: int) -> None:
        self.total = 0.0
        self.epoch = 0
        self.stamp_ns: int | None = None
        self.points: list[tuple[int, float, int]] = []
        self.counters: Counter[str] = Counter()
        self.speed_mps = 0.0
        self.frozen = LeakyBucket(5)
        self.two_senders = False
        self._period_ns = settings.period_ns
        self._top_counts_per_ns = settings.vehicle.jump_speed_mps * settings.counts_per_metre * 1e-9
        self._tolerance = settings.speed_tolerance_m * settings.counts_per_metre
        self._counts_per_metre = settings.counts_per_metre
        self._sign = sign
        self._modulus = modulus
        self._alive = AliveCounter(alive_modulus)
        self._track: Track | None = None
        self._other: Track | None = None
        self._stale_boot: int | None = None
        self._interleaved = 0
        self._alone = 0
        self._residual = 0.0
        self._expected: float | None = 0.0
        self._missing = 0
        self._seen: Track | None = None

    def restart(self) -> None:
        """Forget where the counter stood: motion until the next frame is unknown."""
        self._track = self._other = None

    def update(self, stamp_ns: int, reading: WheelReading) -> str | None:
        """Take one frame; None: accepted, else the reason for refusing it. stamp_ns: monotonic arrival."""
        reason = self._judge(stamp_ns, reading)
        if reason is not None:
            self.counters[reason] += 1
        return reason

    def _judge(self, stamp_ns: int, reading: WheelReading) -> str | None:
        if not reading.status_ok:
            self.restart()
            return "status"
        track = self._track
        if track is None:
            self._begin(Track(stamp_ns, reading))
            return None
        if reading.boot_id != track.reading.boot_id:
            return self._second_track(stamp_ns, reading, "unconfirmed")
        steps, reason = self._steps(track, stamp_ns, reading)
        if reason is not None:
            reason = self._alive.known(reading.alive, reading.position)
            if reason != "alive_frozen":
                return reason
            self.frozen.add()
            return self._second_track(stamp_ns, reading, reason)
        elapsed_ns = stamp_ns - track.stamp_ns
        if self._unknowable(track, reading, elapsed_ns):
            self._begin(Track(stamp_ns, reading))
            return None
        delta = self._delta(track.reading, reading)
        if self._alive.too_soon(steps, elapsed_ns / self._period_ns):
            return self._second_track(stamp_ns, reading, "too_soon")
        if not self._possible(delta, elapsed_ns, steps):
            return self._second_track(stamp_ns, reading, "jump")
        self._follow_speed(stamp_ns, reading)
        if self._speed_disagrees(delta):
            return self._second_track(stamp_ns, reading, "stuck" if delta == 0.0 else "speed_disagrees")
        self._accept(stamp_ns, reading, delta, steps)
        return "two_senders" if self.two_senders else None

    def _steps(self, track: Track, stamp_ns: int, reading: WheelReading) -> tuple[int, str | None]:
        elapsed = (stamp_ns - track.stamp_ns) / self._period_ns
        return self._alive.steps(track.reading.alive, reading.alive, elapsed)

    def _unknowable(self, track: Track, reading: WheelReading, elapsed_ns: int) -> bool:
        """True where the counter may have wrapped unseen, or a node without boot id has started again at 0."""
        farthest = self._top_counts_per_ns * elapsed_ns
        modulus = self._modulus
        if modulus and farthest > modulus / 2:
            self.counters["ambiguous"] += 1
            return True
        if reading.boot_id is not None or elapsed_ns < SILENT_PERIODS * self._period_ns:
            return False
        position = abs(self._signed(reading))
        restarted = position <= farthest + SLACK_COUNTS and position < abs(self._signed(track.reading))
        if restarted:
            self.counters["power_cycle"] += 1
        return restarted

    def _signed(self, reading: WheelReading) -> float:
        """Position on the wire, as near to 0 as its wrap allows."""
        position, modulus = reading.position or 0.0, self._modulus
        return (position + modulus / 2) % modulus - modulus / 2 if modulus else position

    def _delta(self, before: WheelReading, after: WheelReading) -> float:
        """Counts from one position to the next on the wire, the short way round."""
        if before.position is None or after.position is None:
            return 0.0
        difference = after.position - before.position
        modulus = self._modulus
        return (difference + modulus / 2) % modulus - modulus / 2 if modulus else difference

    def _possible(self, delta: float, elapsed_ns: int, steps: int) -> bool:
        """True where a wheel can have turned that far; frames out of a queue get a period each."""
        longest_ns = max(elapsed_ns, steps * self._period_ns)
        return abs(delta) <= self._top_counts_per_ns * longest_ns + SLACK_COUNTS

    def _speed_disagrees(self, delta: float) -> bool:
        """True where counts and speed signal have drifted apart, over half a second."""
        if not self._tolerance or self._expected is None:
            return False
        allowed = self._tolerance * (1 + self._missing) + SLACK_COUNTS
        return abs(RESIDUAL_KEPT * self._residual + delta - self._expected) > allowed

    def _follow_speed(self, stamp_ns: int, reading: WheelReading) -> None:
        """Add up what the speed signal says since the last accepted frame; None: it cannot say."""
        seen = self._seen
        self._seen = Track(stamp_ns, reading)
        if seen is None or self._expected is None or reading.speed is None or seen.reading.speed is None:
            self._expected = None if reading.speed is None else self._expected
            return
        steps, reason = self._steps(seen, stamp_ns, reading)
        if reason is not None or not 1 <= steps <= SPEED_STEPS:
            self._expected = None
            return
        period_s = self._period_ns * 1e-9
        between = 0.5 * (seen.reading.speed + reading.speed)
        self._missing += steps - 1
        self._expected += (reading.speed + (steps - 1) * between) * period_s

    def _begin(self, track: Track) -> None:
        """First frame, or first after a break: the position is where it is, the total stays."""
        if self.stamp_ns is not None:
            self.epoch += 1
            self.counters["gap"] += 1
        self._track, self._other, self._seen = track, None, track
        self._residual, self._expected, self._missing = 0.0, 0.0, 0
        self._interleaved = self._alone = 0
        self._alive.restart()
        self._alive.accept(track.reading.alive, track.reading.position, 1, 1.0)
        self._note(track.stamp_ns)

    def _accept(self, stamp_ns: int, reading: WheelReading, delta: float, steps: int) -> None:
        track = self._track
        assert track is not None
        elapsed_ns = stamp_ns - track.stamp_ns
        self.counters["lost"] += self._alive.accept(
            reading.alive, reading.position, steps, elapsed_ns / self._period_ns
        )
        if self._expected is not None and not self._missing:
            self._residual = RESIDUAL_KEPT * self._residual + delta - self._expected
        self._expected, self._missing = 0.0, 0
        self.frozen.drain()
        self.total += self._sign * delta
        self.speed_mps = self._sign * delta / self._counts_per_metre / max(elapsed_ns, self._period_ns) * 1e9
        self._track = self._seen = Track(stamp_ns, reading)
        self._alone += 1
        if self._other is not None:
            self._other.confirmed = 0  # it goes on beside this one, so it is not what this wheel has become
        if self._alone > SENDERS_FORGOTTEN:
            self._interleaved = 0
            self._other = None
            if self.two_senders:
                self.two_senders = False
                self.epoch += 1
        self._note(stamp_ns)

    def _note(self, stamp_ns: int) -> None:
        self.stamp_ns = stamp_ns if self.stamp_ns is None else max(stamp_ns, self.stamp_ns)
        self.points.append((stamp_ns, self.total, self.epoch))

    def _second_track(self, stamp_ns: int, reading: WheelReading, reason: str) -> str | None:
        """Judge a frame that does not fit the first track; None where the total follows it from now on."""
        other = self._other
        self._alone = 0
        if other is None or reading.boot_id != other.reading.boot_id:
            self._other = Track(stamp_ns, reading)
            return reason
        steps, disorder = self._steps(other, stamp_ns, reading)
        if disorder is not None:
            return reason  # late or twice, as on the first track
        delta = self._delta(other.reading, reading)
        if not self._continues(other, stamp_ns, reading, delta, steps):
            self._other = Track(stamp_ns, reading)
            return reason
        if other.confirmed == 0:
            self._interleaved += 1
            self.two_senders |= self._interleaved >= SENDERS_SURE
        self._other = Track(stamp_ns, reading, other.confirmed + 1, other.gained + delta)
        if self._other.confirmed < self._confirmations(reading):
            return "two_senders" if self.two_senders else reason
        self._follow(self._other)
        return None

    def _follow(self, other: Track) -> None:
        """The second track becomes the first; what it gained counts, unless it was another wheel's."""
        track = self._track
        assert track is not None
        if other.reading.boot_id != track.reading.boot_id:
            self._stale_boot = track.reading.boot_id
            self.counters["power_cycle"] += 1
        if not self.two_senders:
            self.total += self._sign * other.gained
        self.two_senders = False
        self._begin(other)

    def _confirmations(self, reading: WheelReading) -> int:
        """Frames that a second track needs, itself included, while the first is silent."""
        if self.two_senders:
            return SENDERS_FORGOTTEN
        late = reading.boot_id is not None and reading.boot_id == self._stale_boot
        return STALE_CONFIRMATIONS if late or self._interleaved else CONFIRMATIONS

    def _continues(self, other: Track, stamp_ns: int, reading: WheelReading, delta: float, steps: int) -> bool:
        """True where the frame follows the second track as it would have to follow the first."""
        if not self._possible(delta, stamp_ns - other.stamp_ns, steps):
            return False
        if not self._tolerance or reading.speed is None or steps > SPEED_STEPS:
            return True
        expected = reading.speed * steps * self._period_ns * 1e-9
        return abs(delta - expected) <= self._tolerance * steps + SLACK_COUNTS
