"""pytest plugin: fixtures `simulated_rover`, `simulated_laser` and `simulated_wheels`, for other programs.

pytest loads this in every session of an environment that has infant, so it imports nothing until a fixture is used.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from runtime.api.simulated import SimulatedLaser, SimulatedRover, SimulatedWheels


def pytest_configure(config: pytest.Config) -> None:
    """Make the marker known."""
    config.addinivalue_line(
        "markers", "infant_configuration(name): the shipped configuration or file that simulated_rover is made from"
    )


@pytest.fixture
def simulated_rover(request: pytest.FixtureRequest) -> "Iterator[SimulatedRover]":
    """A rover that stands still until drive(); another one for each test."""
    from pathlib import Path

    from runtime.api.simulated import SimulatedRover
    from runtime.settings.configuration import load_configuration

    marker = request.node.get_closest_marker("infant_configuration")
    name = "mock" if marker is None else marker.args[0]
    with SimulatedRover(load_configuration(Path(name))) as rover:
        yield rover


@pytest.fixture
def simulated_laser(simulated_rover: "SimulatedRover") -> "SimulatedLaser":
    """The laser of simulated_rover: its url, and faults with fail() and recover()."""
    return simulated_rover.laser


@pytest.fixture
def simulated_wheels(simulated_rover: "SimulatedRover") -> "SimulatedWheels":
    """The wheels of simulated_rover: their bus, and faults with fail() and recover()."""
    return simulated_rover.wheels
