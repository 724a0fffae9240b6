"""A recorded run for other programs: what came in, what was estimated, and what other settings make of it."""

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

from runtime.api.trajectory import Trajectory
from runtime.errors import NotARunError
from runtime.fault_isolation import step_or_predict
from runtime.map_files.start import AS_RECORDED, for_estimator
from runtime.record.reader import RunReader
from runtime.settings.configuration import Configuration, load_configuration_text
from runtime.tick import Tick
from slam.estimate import Estimate
from slam.estimator import Estimator
from slam.settings.slam import SlamSettings


class Run:
    """A run on disk; each iteration reads it anew and holds one tick at a time."""

    def __init__(self, path: Path) -> None:
        """Raises NotARunError where the folder holds no run."""
        self.path = path
        self._reader = RunReader(path)

    @cached_property
    def configuration(self) -> Configuration:
        """The configuration that was in force. Raises ConfigurationError."""
        text = self._reader.header.configuration_text
        return load_configuration_text(text, source=f"configuration of {self.path}")

    def ticks(self) -> Iterator[Tick]:
        """What came in between two beats of the loop: scan, wheel samples, events. Raises NotARunError."""
        return (recorded.tick for recorded in self._reader.ticks())

    def recorded_estimates(self) -> Iterator[Estimate]:
        """What the rover said while it drove; nothing for an imported run. Raises NotARunError."""
        return (each.estimate for each in self._reader.ticks() if each.estimate is not None)

    def recorded(self) -> Trajectory:
        """The same as a trajectory. Raises NotARunError where the run holds no estimates."""
        trajectory = Trajectory.of(self.recorded_estimates())
        if not trajectory.stamps_ns.size:
            raise NotARunError(f"{self.path} holds no estimates; use estimates() or replay() to make them")
        return trajectory

    def estimates(self, settings: SlamSettings | None = None, seed: int | None = None) -> Iterator[Estimate]:
        """The estimator stepped over every tick again; with neither argument the recorded bits.

        settings: those of the run where absent. seed: likewise.
        """
        configuration = self.configuration
        start = for_estimator(AS_RECORDED.start(self._reader.header, self._reader.folder, configuration))
        chosen = configuration.slam if settings is None else settings
        estimator = Estimator(chosen, configuration.seed if seed is None else seed, start=start)
        return (step_or_predict(estimator, tick)[0] for tick in self.ticks())

    def replay(self, settings: SlamSettings | None = None, seed: int | None = None) -> Trajectory:
        """`estimates` as a trajectory."""
        return Trajectory.of(self.estimates(settings, seed))


def open_run(path: Path | str) -> Run:
    """The run in this folder. Raises NotARunError."""
    return Run(Path(path))
