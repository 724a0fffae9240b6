from drivers.simulated.world.places.building import Building, building_settings
from runtime.smooth.sightings import Witness
from runtime.studies.places.building_drive import building_ticks
from slam.estimator import Estimator
from slam.relocalise.local_map import ScanTaken
from slam.settings.slam import SlamSettings


def test_the_beams_of_a_long_drive_are_not_kept() -> None:
    """26 minutes of them are a gigabyte."""
    building, witness = Building(building_settings(0)), Witness()
    beams: list[bool] = []

    def take(taken: ScanTaken) -> None:
        beams.append(taken.seen.laid is not None)
        witness.take(taken)

    estimator = Estimator(SlamSettings.model_validate({"particles": 5}), 1, witness=take)
    for tick in building_ticks(building, 4.0, 0.02):
        estimator.step(tick.stamp_ns, tick.scan, tick.wheels)
    assert any(beams)
    assert all(taken.seen.laid is None and not len(taken.seen.points_m) for taken in witness._scans)
