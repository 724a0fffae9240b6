"""One wheel's counter: unwraps it and refuses what cannot be motion of that wheel.

Frames that fit the sequence so far are accepted. Frames that do not are kept as a candidate: when it goes on and
turns while the first one is silent, the node has restarted or its count has moved, and the total goes on from there
without the step; when both go on, two nodes send under one id. A candidate that stands still is a fault code.
"""

from collections import Counter

from drivers.settings.encoders import EncoderSettings
from drivers.wheels.alive_counter import AliveCounter
from drivers.wheels.frame_sequence import FrameSequence
from drivers.wheels.leaky_bucket import LeakyBucket
from drivers.wheels.readings import WheelReading

SLACK_COUNTS = 4.0  # quantisation of two readings, and dither at rest
SPEED_STEPS = 3  # the last speed says nothing of more frames than this
RESIDUAL_KEPT = 0.96  # per frame: half a second at 50 Hz
CONFIRMATIONS = 2  # frames of the candidate, the first one included, before the total follows it
STALE_CONFIRMATIONS = 5  # the same where they bear the boot id of before: late frames come at most 3 late
SENDERS_SURE = 4  # interleaved frames of a candidate: late frames before a restart are at most 3
SENDERS_FORGOTTEN = 15  # frames of the current sequence alone, after which there is one sender again
SCATTERED = 3  # frames that belong to nothing: what then fits in the time that has passed may do so by chance
SENTINEL_PERIODS = 3.0  # a value that may mean "not available" is a count only where the last one is this near


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
        self._silent_ns = settings.silent_ns
        self._top_counts_per_ns = settings.vehicle.jump_speed_mps * settings.counts_per_metre * 1e-9
        self._tolerance = settings.speed_tolerance_m * settings.counts_per_metre
        self._counts_per_metre = settings.counts_per_metre
        self._sign = sign
        self._modulus = modulus
        self._alive = AliveCounter(alive_modulus)
        self._sequence: FrameSequence | None = None
        self._candidate: FrameSequence | None = None
        self._stale_boot: int | None = None
        self._interleaved = 0
        self._alone = 0
        self._scattered = 0
        self._residual = 0.0
        self._expected: float | None = 0.0
        self._missing = 0
        self._seen: FrameSequence | None = None
        self._heard_ns = 0

    def restart(self) -> None:
        """Forget where the counter stood: motion until the next frame is unknown."""
        self._sequence = self._candidate = None

    def update(self, stamp_ns: int, reading: WheelReading) -> str | None:
        """Take one frame; None: accepted, else the reason for refusing it. stamp_ns: monotonic arrival."""
        reason = self._judge(stamp_ns, reading)
        self._heard_ns = stamp_ns
        if reason is not None:
            self.counters[reason] += 1
        return reason

    def _judge(self, stamp_ns: int, reading: WheelReading) -> str | None:
        if not reading.status_ok:
            self.restart()
            return "status"
        if reading.is_sentinel and not self._leads_here(stamp_ns, reading):
            return "not_available"
        sequence = self._sequence
        if sequence is None:
            self._begin(FrameSequence(stamp_ns, reading))
            return None
        if reading.boot_id != sequence.reading.boot_id:
            return self._judge_candidate(stamp_ns, reading, "unconfirmed")
        steps, reason = self._steps(sequence, stamp_ns, reading)
        if reason is not None:
            reason = self._alive.known(reading.alive, reading.position)
            if reason != "alive_frozen":
                return reason
            self.frozen.add()
            return self._judge_candidate(stamp_ns, reading, reason)
        elapsed_ns = stamp_ns - sequence.stamp_ns
        delta = self._delta(sequence.reading, reading)
        if reading.direction == 0 and delta != 0.0:
            self.restart()
            return "direction"
        if self._goes_with_candidate(stamp_ns, reading):
            self._integrate_speed(stamp_ns, reading)
            return self._judge_candidate(stamp_ns, reading, "jump")
        if self._is_ambiguous(sequence, stamp_ns, reading):
            self._begin(FrameSequence(stamp_ns, reading))
            return None
        if self._alive.too_soon(steps, elapsed_ns / self._period_ns):
            return self._judge_candidate(stamp_ns, reading, "too_soon")
        if not self._possible(delta, elapsed_ns, steps):
            return self._judge_candidate(stamp_ns, reading, "jump")
        if self._scattered >= SCATTERED and elapsed_ns > SCATTERED * self._period_ns:
            self._begin(FrameSequence(stamp_ns, reading))
            return None
        self._integrate_speed(stamp_ns, reading)
        if self._speed_disagrees(delta):
            return self._judge_candidate(stamp_ns, reading, "stuck" if delta == 0.0 else "speed_disagrees")
        self._accept(stamp_ns, reading, delta, steps)
        return "two_senders" if self.two_senders else None

    def _steps(self, sequence: FrameSequence, stamp_ns: int, reading: WheelReading) -> tuple[int, str | None]:
        elapsed = (stamp_ns - sequence.stamp_ns) / self._period_ns
        return self._alive.steps(sequence.reading.alive, reading.alive, elapsed)

    def _is_ambiguous(self, sequence: FrameSequence, stamp_ns: int, reading: WheelReading) -> bool:
        """True where the counter may have wrapped unseen, or a node without boot id has started again at 0."""
        farthest = self._top_counts_per_ns * (stamp_ns - sequence.stamp_ns)
        modulus = self._modulus
        if modulus and farthest > modulus / 2:
            self.counters["ambiguous"] += 1
            return True
        if reading.boot_id is not None or stamp_ns - self._heard_ns < self._silent_ns:
            return False
        position = abs(self._signed(reading))
        restarted = position <= farthest + SLACK_COUNTS and position < abs(self._signed(sequence.reading))
        if restarted:
            self.counters["power_cycle"] += 1
        return restarted

    def _signed(self, reading: WheelReading) -> float:
        """Position on the wire, as near to 0 as its wrap allows."""
        position, modulus = reading.position or 0.0, self._modulus
        return (position + modulus / 2) % modulus - modulus / 2 if modulus else position

    def _delta(self, before: WheelReading, after: WheelReading) -> float:
        """Counts from one position to the next, the short way round, with the sign of the direction if there is one."""
        if before.position is None or after.position is None:
            return 0.0
        difference = after.position - before.position
        modulus = self._modulus
        short = (difference + modulus / 2) % modulus - modulus / 2 if modulus else difference
        return short * (after.direction or 1)

    def _leads_here(self, stamp_ns: int, reading: WheelReading) -> bool:
        """True where the count passes a value by which devices say that they have none."""
        sequence = self._sequence
        if sequence is None or stamp_ns - sequence.stamp_ns > SENTINEL_PERIODS * self._period_ns:
            return False
        return self._possible(self._delta(sequence.reading, reading), self._period_ns, 1)

    def _goes_with_candidate(self, stamp_ns: int, reading: WheelReading) -> bool:
        """True where a frame goes on from what was refused as a jump: time does not make that jump possible."""
        candidate = self._candidate
        if candidate is None or not candidate.has_jumped or candidate.confirmed < CONFIRMATIONS:
            return False
        steps, disorder = self._steps(candidate, stamp_ns, reading)
        delta = self._delta(candidate.reading, reading)
        return disorder is None and self._continues(candidate, stamp_ns, reading, delta, steps)

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

    def _integrate_speed(self, stamp_ns: int, reading: WheelReading) -> None:
        """Add up what the speed signal says since the last accepted frame; None: it cannot say."""
        seen = self._seen
        self._seen = FrameSequence(stamp_ns, reading)
        speed, speed_before = reading.signed_speed, None if seen is None else seen.reading.signed_speed
        if seen is None or self._expected is None or speed is None or speed_before is None:
            self._expected = None if speed is None else self._expected
            return
        steps, reason = self._steps(seen, stamp_ns, reading)
        if reason is not None or not 1 <= steps <= SPEED_STEPS:
            self._expected = None
            return
        period_s = self._period_ns * 1e-9
        between = 0.5 * (speed_before + speed)
        self._missing += steps - 1
        self._expected += (speed + (steps - 1) * between) * period_s

    def _begin(self, sequence: FrameSequence) -> None:
        """First frame, or first after a break: the position is where it is, the total stays."""
        if self.stamp_ns is not None:
            self.epoch += 1
            self.counters["gap"] += 1
        self._sequence, self._candidate, self._seen = sequence, None, sequence
        self._residual, self._expected, self._missing = 0.0, 0.0, 0
        self._interleaved = self._alone = self._scattered = 0
        self._alive.restart()
        self._alive.accept(sequence.reading.alive, sequence.reading.position, 1, 1.0)
        self._note(sequence.stamp_ns)

    def _accept(self, stamp_ns: int, reading: WheelReading, delta: float, steps: int) -> None:
        sequence = self._sequence
        assert sequence is not None
        elapsed_ns = stamp_ns - sequence.stamp_ns
        self.counters["lost"] += self._alive.accept(
            reading.alive, reading.position, steps, elapsed_ns / self._period_ns
        )
        if self._expected is not None and not self._missing:
            self._residual = RESIDUAL_KEPT * self._residual + delta - self._expected
        self._expected, self._missing, self._scattered = 0.0, 0, 0
        self.frozen.drain()
        self.total += self._sign * delta
        self.speed_mps = self._sign * delta / self._counts_per_metre / max(elapsed_ns, self._period_ns) * 1e9
        self._sequence = self._seen = FrameSequence(stamp_ns, reading)
        self._alone += 1
        if self._candidate is not None:
            self._candidate.confirmed = 0  # it goes on beside this one, so it is not what this wheel has become
        if self._alone > SENDERS_FORGOTTEN:
            self._interleaved = 0
            self._candidate = None
            if self.two_senders:
                self.two_senders = False
                self.epoch += 1
        self._note(stamp_ns)

    def _note(self, stamp_ns: int) -> None:
        self.stamp_ns = stamp_ns if self.stamp_ns is None else max(stamp_ns, self.stamp_ns)
        self.points.append((stamp_ns, self.total, self.epoch))

    def _judge_candidate(self, stamp_ns: int, reading: WheelReading, reason: str) -> str | None:
        """Judge a frame that does not fit the current sequence; None where the total follows it from now on."""
        candidate = self._candidate
        self._alone = 0
        if candidate is None or reading.boot_id != candidate.reading.boot_id:
            self._candidate = FrameSequence(stamp_ns, reading, has_jumped=reason == "jump")
            return reason
        steps, disorder = self._steps(candidate, stamp_ns, reading)
        if disorder is not None:
            return reason  # late or twice, as on the current sequence
        delta = self._delta(candidate.reading, reading)
        if not self._continues(candidate, stamp_ns, reading, delta, steps):
            self._scattered += 1
            self._candidate = FrameSequence(stamp_ns, reading, has_jumped=reason == "jump")
            return reason
        if candidate.confirmed == 0:
            self._interleaved += 1
            self.two_senders |= self._interleaved >= SENDERS_SURE
        self._candidate = FrameSequence(
            stamp_ns, reading, candidate.confirmed + 1, candidate.gained + delta, candidate.has_jumped
        )
        if self._candidate.confirmed < self._confirmations(reading) or not self._has_moved(self._candidate):
            return "two_senders" if self.two_senders else reason
        self._adopt_candidate(self._candidate)
        return None

    def _adopt_candidate(self, candidate: FrameSequence) -> None:
        """The candidate becomes the current sequence; what it gained counts, unless it was another wheel's."""
        sequence = self._sequence
        assert sequence is not None
        if candidate.reading.boot_id != sequence.reading.boot_id:
            self._stale_boot = sequence.reading.boot_id
            self.counters["power_cycle"] += 1
        if not self.two_senders:
            self.total += self._sign * candidate.gained
        self.two_senders = False
        self._begin(candidate)

    def _has_moved(self, candidate: FrameSequence) -> bool:
        """True where what has jumped shows that it counts; a node that says that it booted need not."""
        return not candidate.has_jumped or abs(candidate.gained) > SLACK_COUNTS

    def _confirmations(self, reading: WheelReading) -> int:
        """Frames that a candidate needs, itself included, while the current sequence is silent."""
        if self.two_senders:
            return SENDERS_FORGOTTEN
        late = reading.boot_id is not None and reading.boot_id == self._stale_boot
        return STALE_CONFIRMATIONS if late or self._interleaved else CONFIRMATIONS

    def _continues(
        self, candidate: FrameSequence, stamp_ns: int, reading: WheelReading, delta: float, steps: int
    ) -> bool:
        """True where the frame follows the candidate as it would have to follow the current sequence."""
        if not self._possible(delta, stamp_ns - candidate.stamp_ns, steps):
            return False
        speed = reading.signed_speed
        if not self._tolerance or speed is None or steps > SPEED_STEPS:
            return True
        expected = speed * steps * self._period_ns * 1e-9
        return abs(delta - expected) <= self._tolerance * steps + SLACK_COUNTS
