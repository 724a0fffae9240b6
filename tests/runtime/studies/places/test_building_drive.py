import itertools

import numpy as np
import pytest

from drivers.measurements import Scan
from drivers.simulated.world.places.building import Building, building_settings
from runtime.studies.places.building_drive import building_drive, building_ticks
from runtime.studies.places.figures import quality_shares
from slam.estimate import Quality


@pytest.mark.parametrize("rate_hz", [4.0, 10.0])
def test_scans_come_at_the_rate_that_was_asked_for_and_wheels_at_theirs(rate_hz: float) -> None:
    ticks = list(itertools.islice(building_ticks(Building(building_settings(0, 541)), rate_hz), 60))
    stamps = np.array([tick.stamp_ns for tick in ticks if isinstance(tick.scan, Scan)])
    assert np.ptp(np.diff(stamps)) == 0
    assert np.diff(stamps)[0] == pytest.approx(1e9 / rate_hz)
    samples = [sample.stamp_ns for tick in ticks for sample in tick.wheels]
    assert set(np.diff(samples)) == {20_000_000}


def test_a_short_way_down_the_corridor_is_driven_well_and_twice_alike() -> None:
    first, second = (building_drive(0, 10.0, 541, {"particles": 5}, "test", laps=0.05) for _ in range(2))
    for name in ("cpu_s", "step_max_s"):
        first.pop(name), second.pop(name)
    assert first == second
    assert first["way_m"] == pytest.approx(0.05 * 150.0, abs=0.2)
    assert first["published_rms_m"] < 0.3
    assert first["lost"] == 0.0


def test_a_quality_is_false_where_the_error_says_otherwise() -> None:
    errors = np.array([0.2, 0.2, 5.0, 5.0, 0.8])
    sigma = np.array([0.2, 0.2, 0.3, 4.0, 0.1])
    lost, tracking = Quality.LOST, Quality.TRACKING
    shares = quality_shares(errors, sigma, (lost, tracking, tracking, tracking, lost))
    assert shares == {"false_lost": 0.2, "false_tracking": 0.2}
