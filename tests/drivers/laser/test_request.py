import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.laser.request import scan_request
from drivers.scip.model import Parameters
from drivers.settings.laser import LaserSettings
from drivers.simulated.laser.profiles import PROFILES

UTM = PROFILES["UTM-30LX"].parameters
URG = PROFILES["URG-04LX"].parameters


@given(st.floats(-180, 179), st.floats(1, 360), st.sampled_from([UTM, URG]), st.integers(1, 99))
def test_the_window_is_inside_the_laser_and_inside_what_was_asked(
    low_deg: float, width_deg: float, parameters: Parameters, cluster: int
) -> None:
    high_deg = min(180.0, low_deg + width_deg)
    settings = LaserSettings(angle_min_deg=low_deg, angle_max_deg=high_deg, cluster=cluster)
    request, warnings = scan_request(settings, parameters)
    assert parameters.first_step <= request.first_step <= request.last_step <= parameters.last_step
    if "angles" not in warnings:
        assert math.degrees(parameters.bearing_rad(request.first_step)) >= low_deg - 1e-6
        assert math.degrees(parameters.bearing_rad(request.last_step)) <= high_deg + 1e-6


def test_a_bearing_on_a_step_keeps_that_step() -> None:
    request, warnings = scan_request(LaserSettings(angle_min_deg=-90.0, angle_max_deg=90.0), UTM)
    assert (request.first_step, request.last_step, warnings) == (180, 900, {})


def test_angles_the_model_does_not_have_are_named_with_those_it_has() -> None:
    request, warnings = scan_request(LaserSettings(angle_min_deg=-180.0, angle_max_deg=0.0), UTM)
    assert (request.first_step, request.last_step) == (0, 540)
    assert "laser.angle_min_deg = -180.0" in warnings["angles"]
    assert "-135.0 to 135.0" in warnings["angles"]


def test_a_window_wholly_outside_is_the_whole_laser() -> None:
    request, warnings = scan_request(LaserSettings(angle_min_deg=150.0, angle_max_deg=170.0), UTM)
    assert (request.first_step, request.last_step) == (0, 1080)
    assert "so all are used" in warnings["angles"]


@pytest.mark.parametrize(
    ("speed_rpm", "rate_hz", "interval"), [(2400, 10, 3), (2400, 40, 0), (600, 10, 0), (600, 40, 0)]
)
def test_scans_are_left_out_of_a_faster_laser(speed_rpm: int, rate_hz: float, interval: int) -> None:
    parameters = dataclasses.replace(UTM, speed_rpm=speed_rpm)
    assert scan_request(LaserSettings(rate_hz=rate_hz), parameters)[0].interval == interval
    assert scan_request(LaserSettings(rate_hz=0.5), UTM)[0].interval == 9


@pytest.mark.parametrize(
    ("rate_hz", "reported"), [(10.0, ""), (40.0, ""), (13.0, ""), (15.0, "13.3 a second"), (50.0, "40.0 a second")]
)
def test_a_rate_that_the_laser_cannot_keep_is_named_with_the_one_that_comes(rate_hz: float, reported: str) -> None:
    warnings = scan_request(LaserSettings(rate_hz=rate_hz), UTM)[1]
    assert ("rate" in warnings) == bool(reported)
    assert reported in warnings.get("rate", "")
