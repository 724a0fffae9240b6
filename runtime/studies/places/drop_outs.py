"""Beams without return, as from what is wet, dark or of glass: what they do to the map and to the time of a step."""

from collections.abc import Iterator
from functools import lru_cache

from drivers.settings.simulated_world import WorldSettings
from drivers.simulated.world.places.building import Building, building_settings
from runtime.studies.jobs import Result
from runtime.studies.loss_detection.drives import simulated_ticks
from runtime.studies.places.building_drive import building_ticks
from runtime.studies.places.drive import driven
from runtime.tick import Tick
from slam.estimator import Estimator
from slam.settings.slam import SlamSettings

SHARES = (0.05, 0.2, 0.5)
PARK, CORRIDOR = "park", "building"
PARK_S, BUILDING_LAPS, RATE_HZ = 40.0, 0.15, 10.0


def drop_out_drive(
    where: str,
    share: float,
    seed: int,
    code: str,  # noqa: ARG001  names the job
    length: float = 1.0,
) -> Result:
    """Landmarks at the end and mean CPU time of a step, with the defaults; length: share of the whole drive."""
    _warm()
    settings = WorldSettings(seed=seed) if where == PARK else building_settings(seed)
    laser = settings.laser.model_copy(update={"drop_out_share": share})
    settings = settings.model_copy(update={"laser": laser})
    estimator = Estimator(SlamSettings.model_validate({"mount": {"x_m": laser.body_from_laser[0]}}), seed)
    if where == PARK:
        drive = driven(estimator, _park_ticks(settings, length * PARK_S))
    else:
        drive = driven(estimator, building_ticks(Building(settings), RATE_HZ, length * BUILDING_LAPS))
    return {
        "landmarks": drive.landmarks,
        "step_ms": 1e3 * float(drive.step_s.mean()),
        "step_max_ms": 1e3 * float(drive.step_s.max()),
    }


def _park_ticks(settings: WorldSettings, duration_s: float) -> Iterator[Tick]:
    for seq, tick in enumerate(simulated_ticks(settings, duration_s)):
        yield Tick(seq, tick.stamp_ns, tick.scan, tick.wheels)


@lru_cache(maxsize=1)
def _warm() -> None:
    """Compiling is no part of a step."""
    Estimator.warm_up()
