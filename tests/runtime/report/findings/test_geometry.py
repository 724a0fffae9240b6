from dataclasses import replace

import numpy as np
import pytest

from runtime.calibrate.result import Calibration
from runtime.calibrate.single_causes import Fit
from runtime.report.facts import RunFacts
from runtime.report.finding import Finding
from runtime.report.findings.geometry import PLACES, geometry_findings
from tests.support.runtime.seeded_runs import seeded_facts

START = np.array((0.125, 0.125, 0.5, 0.3, 0.0, 0.0, 0.0))
DEVIATIONS = np.array((1e-4, 1e-4, 2e-3, 2e-3, 2e-3, 1e-3, 3e-3))  # about those of 300 s in the park


@pytest.fixture(scope="module")
def facts(tmp_path_factory: pytest.TempPathFactory) -> RunFacts:
    return seeded_facts(tmp_path_factory.mktemp("run"), 1, duration_s=3.0)


def _titles(facts: RunFacts, together: float = 0.0, **off: float) -> list[str]:
    return [finding.title for finding in _findings(facts, together, **off)]


def _findings(facts: RunFacts, together: float = 0.0, **off: float) -> list[Finding]:
    """Of a fit that lies off the start by so much; together: correlation of the radii."""
    values, correlations = START.copy(), np.eye(7)
    for name, share in off.items():
        values[tuple(PLACES).index(name)] += share
    correlations[0, 1] = correlations[1, 0] = together
    fit = Fit(tuple(PLACES), START, values, correlations * np.outer(DEVIATIONS, DEVIATIONS), 300)
    calibration = Calibration(("run",), (), (), (), 300, 0, 0, fit)
    return geometry_findings(replace(facts, calibration=calibration))


def test_the_smaller_wheel_is_named_with_its_share(facts: RunFacts) -> None:
    assert _titles(facts, wheel_radius_left_m=-0.007 * 0.125) == ["The left wheel is 0.7% smaller than configured"]


def test_where_only_the_difference_is_known_both_wheels_are_named(facts: RunFacts) -> None:
    (title,) = _titles(facts, 0.999, wheel_radius_left_m=-0.00026, wheel_radius_right_m=0.00026)
    assert "left wheel" in title
    assert "or the" in title
    assert "right wheel" in title


def test_both_wheels_together_are_a_matter_of_scale(facts: RunFacts) -> None:
    (title,) = _titles(facts, wheel_radius_left_m=0.00125, wheel_radius_right_m=0.00125)
    assert title.startswith("Both wheels are 1.0% larger")


def test_a_sure_deviation_that_does_not_matter_is_no_finding(facts: RunFacts) -> None:
    assert not _titles(facts, laser_yaw_rad=0.008)
    assert _titles(facts, laser_yaw_rad=0.0314) == ["The laser is turned by +1.8 deg from its configured yaw"]


def test_a_large_deviation_is_told_in_digits_that_people_read(facts: RunFacts) -> None:
    (finding,) = _findings(facts, laser_x_m=-1.0613)
    assert finding.evidence[0].startswith("laser ahead of the axle: -1060 mm from the configured value, +- 3.9 (95 %)")
