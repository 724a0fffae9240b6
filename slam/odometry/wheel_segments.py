"""Wheel samples cut into segments of constant motion that end exactly at the time asked for."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.measurements import FloatArray, OdometryPose, SpeedSteering, SpeedYawRate, WheelCounts, WheelSample
from slam.arithmetic.elementary import squared
from slam.arithmetic.functions import cosine_sine
from slam.odometry.motion import SEGMENT_COLUMNS
from slam.pose import wrap_rad
from slam.settings.odometry import OdometrySettings

GAP_SPEED_MPS = 0.5  # m/s, standard deviation of the speed while it is unknown
GAP_YAW_RATE_RADPS = 0.5  # rad/s, the same for the yaw rate
EXTRAPOLATION_S = 0.1  # s for which the last speed is carried on past the last sample
NANOSECOND_S = 1e-9
LONGEST_S = 60.0  # after a minute without wheels the rover is lost, and more variance says nothing more
SHORTEST_S = 0.02  # counts that arrive in a bunch are not a jump
GAP_SHAPE = 0.2  # of the distance rolled in a gap: how far its end may lie off a single arc, one deviation
SAMPLE_KIND = {
    "differential": WheelCounts,
    "steered": SpeedSteering,
    "speed_yaw_rate": SpeedYawRate,
    "pose": OdometryPose,
}


@dataclass(frozen=True, slots=True)
class Cursor:
    """How far the samples have been used.

    now_ns: end of the last segment, None before the first. measured: the last sample, as the wheels gave it.
    sample: the same moved on to now_ns if now lies between two samples, so that what an extrapolation got wrong is
    made up for by the next one. rate: controls per second (counts and poses). lost: True while the wheels say that they
    do not know.
    """

    now_ns: int | None = None
    measured: WheelSample | None = None
    sample: WheelSample | None = None
    rate: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lost: bool = False


@dataclass(frozen=True, slots=True)
class Segments:
    """rows (n, 9) as slam.motion lays them out; known: False if a part of the time had no valid sample.

    gap_correction_m: (left, right) by which earlier segments carried on too little or too much in gaps that ended here.
    A filter has seen better by itself meanwhile; only dead reckoning makes up for it.
    """

    rows: FloatArray
    known: bool
    jumps: int
    gap_correction_m: tuple[float, float] = (0.0, 0.0)


class Segmenter:
    """Turns samples into segments; holds no state of its own, so that a prediction consumes nothing."""

    def __init__(self, settings: OdometrySettings) -> None:
        self._settings = settings
        self._integrated = settings.model in ("differential", "pose")
        turn = 2.0 * math.pi / settings.counts_per_rev
        self._metres_per_count = (settings.wheel_radius_left_m * turn, settings.wheel_radius_right_m * turn)

    @property
    def count_m(self) -> float:
        """Travel of one count, the larger of both wheels; 0 where nothing is counted."""
        return max(self._metres_per_count) if self._settings.model == "differential" else 0.0

    def until(self, cursor: Cursor, samples: Sequence[WheelSample], stamp_ns: int) -> tuple[Segments, Cursor, int]:
        """Segments from cursor to stamp_ns, the cursor there, and how many samples lie behind it."""
        rows: list[tuple[float, ...]] = []
        corrections: list[tuple[float, float]] = []
        known, jumps, used = True, 0, 0
        if cursor.now_ns is None and (not samples or samples[0].stamp_ns > stamp_ns):
            return Segments(np.empty((0, SEGMENT_COLUMNS)), False, 0), replace(cursor, now_ns=stamp_ns), 0
        for sample in samples:
            if sample.stamp_ns > stamp_ns:
                break
            used += 1
            cursor, certain, jumped = self._to_sample(cursor, sample, rows, corrections)
            known, jumps = known and certain, jumps + jumped
        if cursor.now_ns is not None and cursor.now_ns < stamp_ns:
            following = samples[used] if used < len(samples) else None
            cursor, certain = self._past_samples(cursor, following, stamp_ns, rows)
            known = known and certain
        correction_m = (sum(left for left, _ in corrections), sum(right for _, right in corrections))
        return Segments(np.array(rows).reshape(-1, SEGMENT_COLUMNS), known, jumps, correction_m), cursor, used

    def unknown(self, duration_s: float) -> Segments:
        """A time of which the wheels have said nothing."""
        return Segments(np.array((self._unknown(duration_s),)), False, 0)

    def _to_sample(
        self, cursor: Cursor, sample: WheelSample, rows: list[tuple[float, ...]], corrections: list[tuple[float, float]]
    ) -> tuple[Cursor, bool, int]:
        """One segment that ends at a sample."""
        if isinstance(sample, WheelCounts) and not sample.valid:
            # what follows it decides whether the time up to it stays unknown
            return replace(cursor, lost=True, now_ns=cursor.now_ns or sample.stamp_ns), cursor.now_ns is not None, 0
        stamp_ns = sample.stamp_ns
        fresh = Cursor(stamp_ns, sample, sample, cursor.rate)
        if cursor.now_ns is None:
            return fresh, True, 0
        duration = (stamp_ns - cursor.now_ns) * NANOSECOND_S
        if cursor.sample is None or cursor.measured is None:
            rows.append(self._unknown(duration))
            return fresh, False, 0
        silence = (stamp_ns - cursor.measured.stamp_ns) * NANOSECOND_S
        gap = silence if cursor.lost or silence > self._settings.gap_s else 0.0
        if isinstance(sample, OdometryPose):
            gap = 0.0  # the base adds up its own motion, whether anybody listens or not
        if not self._integrated:
            held = min(duration, max(0.0, self._settings.gap_s - silence + duration))
            rows.append(self._held(cursor.sample, held))
            rows.append(self._unknown(duration - held))
            return fresh, duration - held <= 0.0, 0
        whole = self._difference(cursor.measured, sample)
        if self._is_jump(whole, silence):
            rows.append(self._unknown(duration))
            return Cursor(stamp_ns, sample, sample), False, 1
        rate = (whole[0] / silence, whole[1] / silence, whole[2] / silence)
        if gap > 0.0 and isinstance(sample, WheelCounts) and sample.unbroken:
            first, second, _ = self._difference(cursor.sample, sample)
            uneven = (first - rate[0] * duration, second - rate[1] * duration)
            rows.append(self._rest_of_gap(duration, silence, rate, uneven))
            corrections.append(uneven)
            return Cursor(stamp_ns, sample, sample, rate), True, 0
        before = cursor.measured if cursor.lost else cursor.sample
        rows.append(self._moved(duration, self._difference(before, sample), gap))
        return Cursor(stamp_ns, sample, sample, rate), gap == 0.0, 0

    def _past_samples(
        self, cursor: Cursor, following: WheelSample | None, stamp_ns: int, rows: list[tuple[float, ...]]
    ) -> tuple[Cursor, bool]:
        """From the last sample on: interpolated towards the next one, else carried on for a short while."""
        assert cursor.now_ns is not None
        duration = (stamp_ns - cursor.now_ns) * NANOSECOND_S
        settings = self._settings
        if cursor.sample is None or cursor.measured is None:
            rows.append(self._unknown(duration))
            return replace(cursor, now_ns=stamp_ns), False
        since = (cursor.now_ns - cursor.measured.stamp_ns) * NANOSECOND_S
        if not self._integrated:
            held = min(duration, max(0.0, settings.gap_s - since))
            rows.append(self._held(cursor.sample, held))
            rows.append(self._unknown(duration - held))
            return replace(cursor, now_ns=stamp_ns), held == duration
        if cursor.lost:
            # it will hardly have stopped at once, nor go on for ever
            carried = min(duration, max(0.0, settings.gap_s - since))
            motion = (cursor.rate[0] * carried, cursor.rate[1] * carried, cursor.rate[2] * carried)
            rows.append(self._moved(carried, motion, carried))
            rows.append(self._unknown(duration - carried))
            moved = self._moved_sample(cursor.sample, motion, stamp_ns)
            return replace(cursor, now_ns=stamp_ns, sample=moved), False
        if following is not None and self._bridges(cursor.measured, following):
            fraction = (stamp_ns - cursor.now_ns) / (following.stamp_ns - cursor.now_ns)
            motion = self._difference(cursor.sample, following)
            motion = (motion[0] * fraction, motion[1] * fraction, motion[2] * fraction)
            carried = duration
        else:
            carried = min(duration, max(0.0, EXTRAPOLATION_S - since))
            motion = (cursor.rate[0] * carried, cursor.rate[1] * carried, cursor.rate[2] * carried)
        rows.append(self._moved(carried, motion, 0.0))
        rows.append(self._unknown(duration - carried))
        moved = self._moved_sample(cursor.sample, motion, stamp_ns)
        return replace(cursor, now_ns=stamp_ns, sample=moved), carried == duration

    def _bridges(self, measured: WheelSample, following: WheelSample) -> bool:
        """True where the motion up to the next sample is known well enough to be interpolated."""
        if isinstance(following, WheelCounts) and not following.valid:
            return False
        apart = (following.stamp_ns - measured.stamp_ns) * NANOSECOND_S
        return apart <= self._settings.gap_s and not self._is_jump(self._difference(measured, following), apart)

    def _is_jump(self, motion: tuple[float, float, float], duration: float) -> bool:
        """Whether no vehicle moves so far in this time, along or across."""
        return max(abs(length) for length in motion) > self._settings.jump_speed_mps * max(duration, SHORTEST_S)

    def _difference(self, before: WheelSample, after: WheelSample) -> tuple[float, float, float]:
        """(left m, right m, 0) between counts; (distance m, turn rad, lateral m) of the arc between poses."""
        if isinstance(before, WheelCounts) and isinstance(after, WheelCounts):
            left, right = self._metres_per_count
            return (after.left - before.left) * left, (after.right - before.right) * right, 0.0
        assert isinstance(before, OdometryPose)
        assert isinstance(after, OdometryPose)
        turn = wrap_rad(after.heading_rad - before.heading_rad)
        x, y = after.x_m - before.x_m, after.y_m - before.y_m
        cosine, sine = cosine_sine(before.heading_rad)
        ahead, left = cosine * x + sine * y, -sine * x + cosine * y
        half = 0.5 * turn
        stretch = 1.0
        if abs(half) > 1e-6:
            half_cosine, half_sine = cosine_sine(half)
            stretch = half * half_cosine / half_sine
        return stretch * ahead + half * left, turn, stretch * left - half * ahead

    def _moved_sample(self, sample: WheelSample, motion: tuple[float, float, float], stamp_ns: int) -> WheelSample:
        """The sample that a wheel would have given after `motion`."""
        if isinstance(sample, WheelCounts):
            left, right = self._metres_per_count
            return WheelCounts(stamp_ns, sample.left + motion[0] / left, sample.right + motion[1] / right)
        assert isinstance(sample, OdometryPose)
        distance, turn, lateral = motion
        along, across = 1.0, 0.0
        if abs(turn) > 1e-9:
            turned_cosine, turned_sine = cosine_sine(turn)
            along, across = turned_sine / turn, (1.0 - turned_cosine) / turn
        ahead, left = distance * along - lateral * across, distance * across + lateral * along
        cosine, sine = cosine_sine(sample.heading_rad)
        x, y = sample.x_m + cosine * ahead - sine * left, sample.y_m + sine * ahead + cosine * left
        return OdometryPose(stamp_ns, x, y, sample.heading_rad + turn)

    def _unknown(self, duration: float) -> tuple[float, ...]:
        """Nothing is known of this time: no motion, and a variance that says so."""
        blind = min(duration, LONGEST_S)
        distance = squared(GAP_SPEED_MPS * blind)
        heading = squared(GAP_YAW_RATE_RADPS * blind)
        return (duration, 0.0, 0.0, 0.0, 0.0, 0.0, distance, distance, heading)

    def _held(self, sample: WheelSample, duration: float) -> tuple[float, ...]:
        """A speed held for a while; without any noise when the wheels stand still."""
        settings = self._settings
        assert isinstance(sample, SpeedSteering | SpeedYawRate)
        speed, still = sample.speed_mps, sample.speed_mps == 0.0
        if isinstance(sample, SpeedSteering):
            second, deviation = sample.steering_rad, settings.steering_noise_rad
        else:
            second, deviation = sample.yaw_rate_radps, settings.yaw_rate_noise_radps
            still = still and second == 0.0
        if still or duration <= 0.0:
            return (max(duration, 0.0), speed, second, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        # white noise of density variance * noise_time: shorter segments are noisier, their sum is not
        density = settings.noise_time_s / max(duration, 0.25 * settings.noise_time_s)
        first_variance = (squared(settings.speed_noise_mps) + squared(settings.speed_noise_ratio * speed)) * density
        sideways, heading = self._floors(abs(speed) * duration)
        return (duration, speed, second, 0.0, first_variance, squared(deviation) * density, 0.0, sideways, heading)

    def _moved(self, duration: float, motion: tuple[float, float, float], gap: float) -> tuple[float, ...]:
        """A measured displacement; gap: seconds of it in which the wheels were silent."""
        settings = self._settings
        first, second, lateral = motion
        slip = squared(settings.slip_m_per_sqrt_m)
        if settings.model == "differential":
            variances, rolled = (slip * abs(first), slip * abs(second)), 0.5 * (abs(first) + abs(second))
        else:
            rolled = math.hypot(first, lateral)
            variances = (slip * rolled, squared(settings.heading_rad_per_sqrt_rad) * abs(second))
        sideways, heading = self._floors(rolled)
        blind = min(gap, LONGEST_S)
        forward = squared(GAP_SPEED_MPS * blind)
        heading += squared(GAP_YAW_RATE_RADPS * blind)
        return (duration, first, second, lateral, *variances, forward, sideways + forward, heading)

    def _rest_of_gap(
        self, duration: float, silence: float, rate: tuple[float, float, float], uneven: tuple[float, float]
    ) -> tuple[float, ...]:
        """The last part of a gap over which the counters went on: its motion is known, its way only nearly.

        silence: s of the whole gap, rate: its mean. uneven: (left m, right m) by which what was carried on in earlier
        parts differs from driving at that rate; as much may really belong to this part.
        """
        settings = self._settings
        row = list(self._moved(duration, (rate[0] * duration, rate[1] * duration, 0.0), 0.0))
        shape = GAP_SHAPE * 0.5 * (abs(rate[0]) + abs(rate[1])) * silence
        forward = min(0.5 * abs(uneven[0] + uneven[1]), GAP_SPEED_MPS * duration)
        turn = min(abs(uneven[1] - uneven[0]) / settings.tread_m, GAP_YAW_RATE_RADPS * duration)
        share = duration / silence
        row[6] += squared(shape * share) + squared(forward)
        row[7] += squared(shape * share)
        row[8] += squared(turn)
        return tuple(row)

    def _floors(self, rolled_m: float) -> tuple[float, float]:
        """Variances sideways m^2 and of the heading rad^2 that grow with the distance rolled."""
        settings = self._settings
        return squared(settings.lateral_m_per_sqrt_m) * rolled_m, squared(settings.heading_rad_per_sqrt_m) * rolled_m
