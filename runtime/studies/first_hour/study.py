"""Each unknown rover is set up over its wires, driven for 90 s, calibrated and driven again, and no line typed.

The drives are those of the real loop by a clock that skips sleep.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from drivers.simulated.rover import Rover
from runtime.calibrate.recorded_drives import calibrate_runs
from runtime.calibrate.write import text_to_write_into, write_configuration
from runtime.settings.configuration import load_configuration
from runtime.setup.discover.listen import find_laser, hear
from runtime.setup.discover.wizard import Known, set_up
from runtime.setup.validation import validate_for_live_run
from runtime.studies.first_hour.rovers import ROVERS, UnknownRover
from runtime.studies.soak.stepped_drive import stepped_drive

CALIBRATION_S, DRIVE_S = 90.0, 60.0
MOST_M = 0.1
PATIENCE_S = 120.0  # for a laser whose computer does much else


@dataclass(frozen=True, slots=True)
class FirstHour:
    """What became of one rover. set_up_s: in real time. Errors: RMS and largest distance from the truth, m."""

    rover: str
    laser: str
    layout: str
    set_up_s: float
    lines: int
    calibrated: tuple[str, ...]
    before_rms_m: float
    rms_m: float
    largest_m: float
    odometry_rms_m: float

    @property
    def drives(self) -> bool:
        """Within what is asked for."""
        return self.rms_m < MOST_M


def first_hour(rover: UnknownRover, folder: Path) -> FirstHour:
    """From its wires to a calibrated drive; configuration and runs are kept in the folder. Raises InfantError."""
    path, began_s = folder / f"{rover.name}.toml", time.monotonic()
    heard = _set_up(rover, path)
    set_up_s = time.monotonic() - began_s
    configuration = load_configuration(path)
    validate_for_live_run(configuration, str(path))
    run = folder / f"{rover.name}-calibration"
    before = stepped_drive(configuration, rover.simulation, CALIBRATION_S, run)
    into = text_to_write_into(path)
    result, believed = calibrate_runs([run], configuration)
    changed = write_configuration(result, believed.text, path, into)
    after = stepped_drive(load_configuration(path), rover.simulation, DRIVE_S, folder / f"{rover.name}-drive")
    figures = (before["slam_rms_m"], after["slam_rms_m"], after["slam_max_m"], after["odometry_rms_m"])
    lines = sum(bool(line.strip()) for line in path.read_text(encoding="utf-8").splitlines())
    return FirstHour(rover.name, rover.model, heard, round(set_up_s, 1), lines, changed, *figures)


def _set_up(rover: UnknownRover, path: Path) -> str:
    """Write the configuration; the name of the layout that was heard."""
    devices = Rover(rover.simulation, rover.encoders, time.monotonic_ns)
    devices.start()
    try:
        bus = devices.encoders.bus
        known = Known(devices.laser_url, f"{bus.interface}:{bus.channel}:{bus.port}")
        search = (lambda urls: find_laser(urls, PATIENCE_S)), hear
        return set_up(path, rover.name, known, lambda: rover.told, lambda _line: None, search).fitting[0].name
    finally:
        devices.close()


def study(folder: Path, say: Callable[[str], object], rovers: Sequence[UnknownRover] = ROVERS) -> dict[str, Any]:
    """All rovers, each told as it is done. Raises InfantError."""
    results = []
    for rover in rovers:
        results.append(first_hour(rover, folder))
        say(line_of(results[-1]))
    good = sum(each.drives for each in results)
    say(f"{good} of {len(results)} drive within {MOST_M:g} m, no line written by hand")
    return {"good": good, "rovers": [asdict(each) for each in results]}


def line_of(each: FirstHour) -> str:
    """For a person."""
    return (
        f"{each.rover:20s} {each.laser:10s} {each.layout:10s} set up in {each.set_up_s:5.1f} s, {each.lines} lines; "
        f"RMS {each.before_rms_m:.3f} m before, {each.rms_m:.3f} m after calibration, at most {each.largest_m:.3f} m "
        f"(odometry alone {each.odometry_rms_m:.3f} m)"
    )
