"""A drive in virtual time: simulated nodes, their faults, and the reader's pure part, with the truth beside it."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drivers.canbus.error_frames import ErrorFrames
from drivers.canbus.frame import ERROR, CanFrame
from drivers.measurements import WheelCounts
from drivers.settings.encoders import EncoderSettings
from drivers.settings.simulated_wheels import SimulatedWheelSettings, WheelFault
from drivers.simulated.wheels.encoder_nodes import EncoderNodes
from drivers.wheels.layouts.choose import wheel_decoder
from drivers.wheels.pair import WheelPair
from drivers.wheels.readings import Wheel

BEAT_NS = 20_000_000
START_NS = 5_000_000_000
SETTINGS = EncoderSettings()
FRAMES = wheel_decoder(SETTINGS)


@dataclass
class VirtualDrive:
    """Drives a rover along a lively course; wheel speeds stay below 1.9 m/s."""

    seed: int
    settings: SimulatedWheelSettings = field(default_factory=SimulatedWheelSettings)
    encoders: EncoderSettings = SETTINGS

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.now_ns = START_NS
        self.nodes = EncoderNodes(self.settings, self.encoders, START_NS, self.rng)
        self.pair = WheelPair(self.encoders, FRAMES if self.encoders == SETTINGS else wheel_decoder(self.encoders))
        self.errors = ErrorFrames()
        self.samples: list[WheelCounts] = []
        self.frames: list[CanFrame] = []
        self.truth: dict[Wheel, list[tuple[int, float]]] = {wheel: [] for wheel in Wheel}
        self.phase = float(self.rng.uniform(0.0, 6.0))
        self.next_info_ns = START_NS

    def travel_m(self, wheel: Wheel, stamp_ns: int) -> float:
        """True way of one wheel: speeds swing about 1 m/s and -0.2 m/s, sides differ."""
        t = (stamp_ns - START_NS) * 1e-9 + self.phase
        side = 1.0 if wheel is Wheel.LEFT else -1.0
        return 0.6 * t - math.cos(1.3 * t) / 1.3 * 0.8 + side * 0.3 * math.sin(0.9 * t)

    def run(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds * 1e9 / BEAT_NS)):
            self.now_ns += BEAT_NS
            for wheel, delay_ns in ((Wheel.LEFT, 0), (Wheel.RIGHT, 700_000)):
                stamp_ns = self.now_ns + delay_ns + int(abs(self.rng.normal(0.0, 300_000)))
                frames = self.nodes.beat(wheel, stamp_ns, self.travel_m(wheel, stamp_ns))
                self.truth[wheel].append((stamp_ns, float(self.nodes.true_count(wheel))))
                self.deliver(frames)
            if self.now_ns >= self.next_info_ns:
                self.next_info_ns += 1_000_000_000
                for wheel in Wheel:
                    self.deliver(self.nodes.info(wheel, self.now_ns + 1_500_000))
            self.pair.check(self.now_ns + 2_000_000)
            self.samples += self.pair.take()

    def run_until_valid(self, longest_s: float) -> bool:
        """Let time pass until both wheels are trusted again; False where that takes too long."""
        start_ns = self.now_ns
        while self.now_ns - start_ns < longest_s * 1e9:
            self.run(0.04)
            last = self.samples[-1]
            if last.valid and last.stamp_ns > start_ns and not self.pair.trouble(self.now_ns):
                return True
        return False

    def deliver(self, frames: list[CanFrame]) -> None:
        self.frames += frames
        for frame in frames:
            if frame.flags & ERROR:
                for name in self.errors.error(frame.arbitration_id, frame.data):
                    self.pair.events.count(name)
            else:
                self.pair.feed(frame)

    def inject(self, name: str, values: dict[str, Any]) -> None:
        fault = WheelFault.model_validate({"kind": name, **values})
        self.nodes.inject(fault, self.now_ns)

    def clear(self) -> None:
        self.deliver(self.nodes.clear(self.now_ns))

    def true_counts(self, stamp_ns: int) -> tuple[float, float]:
        """What both wheels had really counted at an instant."""
        values = []
        for wheel in Wheel:
            stamps, counts = zip(*self.truth[wheel], strict=True)
            values.append(float(np.interp(stamp_ns, stamps, counts)))
        return values[0], values[1]

    def wrong_motion_m(self) -> float:
        """Largest error of any wheel's motion between samples that claim to know it, and over declared gaps.

        Over a gap the totals may be right from its beginning, or only from its last invalid sample on, for both
        wheels alike: anything else would turn the rover.
        """
        instants = [sample.stamp_ns for sample in self.samples]
        true = []
        for wheel in Wheel:
            stamps, counts = zip(*self.truth[wheel], strict=True)
            true.append(np.interp(instants, stamps, counts))
        deviation = np.array([(sample.left, sample.right) for sample in self.samples]).T - np.array(true)
        worst = 0.0
        reference = deviation[:, 0]
        before: WheelCounts | None = None
        for index, sample in enumerate(self.samples):
            if sample.valid:
                error = float(np.max(np.abs(deviation[:, index] - reference)))
                if before is not None and not before.valid:
                    error_since = float(np.max(np.abs(deviation[:, index] - deviation[:, index - 1])))
                    error = min(error, error_since)
                    reference = deviation[:, index]
                worst = max(worst, error)
            before = sample
        return worst / self.encoders.counts_per_metre
