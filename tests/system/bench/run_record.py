"""What the record of a run on the bench says: errors against the truth, wheels against theirs, events by time."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.measurements import Event, WheelCounts
from drivers.simulated.rover import world_for
from drivers.simulated.world.places.world import World
from runtime.messages.recorded_tick import RecordedTick
from runtime.record.reader import RunReader
from runtime.settings.configuration import load_configuration_text

SECOND_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Phase:
    """Trouble as the guest made it, in monotonic nanoseconds."""

    name: str
    began_ns: int
    ended_ns: int


class BenchRecord:
    """One run, read to its end."""

    def __init__(self, run: Path) -> None:
        reader = RunReader(run)
        self.ticks: list[RecordedTick] = list(reader.ticks())
        self.configuration = load_configuration_text(reader.header.configuration_text)
        self.samples = [s for r in self.ticks for s in r.tick.wheels if isinstance(s, WheelCounts)]
        self.events = [event for r in self.ticks for event in r.tick.events]

    def events_in(self, phase: Phase, source: str, more_s: float = 1.0) -> list[Event]:
        """Events of a source from the beginning of a phase until a while after its end."""
        until_ns = phase.ended_ns + round(more_s * SECOND_NS)
        return [e for e in self.events if e.source == source and phase.began_ns <= e.stamp_ns <= until_ns]

    def errors_m(self, from_ns: int, to_ns: int) -> list[float]:
        """Distance of every pose in this time from the truth."""
        errors = []
        for recorded in self.ticks:
            estimate, truth = recorded.estimate, recorded.truth
            if estimate is None or truth is None or not from_ns <= recorded.tick.stamp_ns <= to_ns:
                continue
            pose = estimate.map_from_body
            errors.append(float(np.hypot(pose.x_m - truth.x_m, pose.y_m - truth.y_m)))
        return errors

    def recovery_s(self, phase: Phase) -> float:
        """From the end of a phase to the first good sample after it."""
        after = [s.stamp_ns for s in self.samples if s.valid and s.stamp_ns > phase.ended_ns]
        return (after[0] - phase.ended_ns) * 1e-9 if after else float("inf")

    def wrong_wheel_m(self) -> float:
        """Largest error of a wheel's motion between good samples that claim to join, against the simulated course."""
        assert self.configuration.simulation is not None
        assert self.configuration.encoders is not None
        world = World(world_for(self.configuration.simulation))
        start_ns = self.ticks[0].tick.stamp_ns - self.ticks[0].tick.seq * 100_000_000
        metres = 1.0 / self.configuration.encoders.counts_per_metre
        worst, reference = 0.0, None
        for sample in self.samples:
            if not sample.valid:
                continue
            true = np.array(world.wheel_travel_m(sample.stamp_ns - start_ns))
            deviation = np.array((sample.left, sample.right)) * metres - true
            reference = deviation if reference is None else reference
            worst = max(worst, float(np.abs(deviation - reference).max()))
        return worst

    def missed(self) -> int:
        """Beats that the loop says it overslept."""
        return sum(timing.missed for r in self.ticks if (timing := r.timing) is not None)
