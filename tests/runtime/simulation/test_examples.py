"""The rovers of config/examples: each drives the real loop over the wires of devices that are built as it says."""

from pathlib import Path

import pytest

from drivers.settings.laser import SerialEndpoint, endpoint
from drivers.settings.simulated_laser import LaserModel
from drivers.settings.simulated_world import Place
from drivers.settings.simulation import SimulationSettings
from runtime.settings.configuration import Configuration, load_configuration
from runtime.setup.validation import validate_for_live_run
from runtime.simulation.as_configured import simulation_of
from runtime.source_tree import CONFIG
from runtime.studies.soak.stepped_drive import stepped_drive

ROVERS: dict[str, tuple[LaserModel, Place]] = {
    "turtlebot_vesc": ("URG-04LX", "corridor"),
    "ust_odrive": ("UST-20LX", "park"),
    "utm_cia402": ("UTM-30LX", "orchard"),
    "backwards_laser": ("UST-10LX", "building"),
    "upside_down_laser": ("UST-20LX", "park"),
    "steered": ("UST-20LX", "park"),
}
DRIVEN_S = 10.0
MOST_RMS_M = 0.1
MOST_LINES = 40


def test_every_example_is_driven_and_named_after_what_it_shows() -> None:
    assert {path.stem for path in (CONFIG / "examples").glob("*.toml")} == set(ROVERS)


def simulated(configuration: Configuration, kind: tuple[LaserModel, Place], folder: Path) -> SimulationSettings:
    """With the laser on a serial line where the configuration has it there."""
    simulation = simulation_of(configuration, *kind)
    assert configuration.laser is not None
    if not isinstance(endpoint(configuration.laser.url), SerialEndpoint):
        return simulation
    laser = simulation.laser.model_copy(update={"pty": str(folder / "lidar")})
    return simulation.model_copy(update={"laser": laser})


@pytest.mark.parametrize("name", ROVERS)
def test_an_example_is_a_short_file_that_drives_a_rover_of_its_kind(name: str, tmp_path: Path) -> None:
    path = CONFIG / "examples" / f"{name}.toml"
    configuration = load_configuration(path)
    validate_for_live_run(configuration, str(path))
    lines = path.read_text(encoding="utf-8").splitlines()
    assert sum(bool(line.strip()) for line in lines) <= MOST_LINES
    assert sum("#" in line for line in lines) >= 5
    simulation = simulated(configuration, ROVERS[name], tmp_path)
    driven = stepped_drive(configuration, simulation, DRIVEN_S, tmp_path / "run")
    assert driven["scans"] > 40
    assert driven["slam_rms_m"] < MOST_RMS_M


def test_what_a_file_says_of_the_mount_matters(tmp_path: Path) -> None:
    """With the laser believed to stand the same drive is a mirrored one, and its pose far worse."""
    configuration = load_configuration(CONFIG / "examples" / "upside_down_laser.toml")
    simulation = simulated(configuration, ROVERS["upside_down_laser"], tmp_path)
    mount = configuration.slam.mount.model_copy(update={"upside_down": False})
    believed = configuration.model_copy(update={"slam": configuration.slam.model_copy(update={"mount": mount})})
    driven = stepped_drive(believed, simulation, DRIVEN_S, tmp_path / "run")
    assert driven["slam_rms_m"] > 0.5 * MOST_RMS_M
