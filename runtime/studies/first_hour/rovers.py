"""Five rovers whose owner knows what a ruler and a data sheet say, and not how they were really built."""

import math
from dataclasses import dataclass

from drivers.settings.can import BusSettings
from drivers.settings.encoders import EncoderSettings, WheelSettings
from drivers.settings.layouts import DbcLayout, Layout, PresetLayout
from drivers.settings.simulated_laser import LaserModel, SimulatedLaserSettings
from drivers.settings.simulated_wheels import SimulatedWheelSettings
from drivers.settings.simulated_world import DriveSettings, LaserGeometrySettings, WorldSettings
from drivers.settings.simulation import SimulationSettings
from runtime.setup.discover.written import Geometry

EIGHT_M = ((4.0, 0.0), (4.0, 4.0), (-4.0, -4.0), (-4.0, 0.0))  # a figure of eight: turns both ways, and straight on
# what a ruler does not see: tyres, the middle of a tyre's tread, the laser's axis
LEFT_FACTOR, RIGHT_FACTOR, TREAD_FACTOR = 1.012, 0.994, 1.02
OFF_MOUNT = (0.02, -0.015, math.radians(1.5))  # m, m, rad


@dataclass(frozen=True, slots=True)
class UnknownRover:
    """told: what its owner answers. layout: what its wheels speak, which is for setup to find."""

    name: str
    model: LaserModel
    layout: Layout
    told: Geometry

    @property
    def simulation(self) -> SimulationSettings:
        """What is true."""
        x_m, y_m, yaw_rad = OFF_MOUNT
        yaw_rad += math.pi if self.told.laser_backwards else 0.0
        mount = (self.told.laser_ahead_m + x_m, y_m, math.remainder(yaw_rad, 2.0 * math.pi))
        laser = LaserGeometrySettings(body_from_laser=mount, upside_down=self.told.laser_upside_down)
        drive = DriveSettings(corners_m=EIGHT_M, tread_m=self.told.tread_m * TREAD_FACTOR)
        return SimulationSettings(
            world=WorldSettings(drive=drive, laser=laser),
            laser=SimulatedLaserSettings(model=self.model),
            wheels=SimulatedWheelSettings(
                counts_per_rev=self.told.counts_per_rev,
                wheel_radius_m=self.told.wheel_radius_m,
                left_radius_factor=LEFT_FACTOR,
                right_radius_factor=RIGHT_FACTOR,
            ),
        )

    @property
    def encoders(self) -> EncoderSettings:
        """The bus and the layout of its nodes."""
        return EncoderSettings(bus=BusSettings(), layout=self.layout, left=WheelSettings(), right=WheelSettings())


def _preset(name: str, left: int) -> PresetLayout:
    return PresetLayout.model_validate({"kind": "preset", "name": name, "left_node": left, "right_node": left + 1})


ROVERS = (
    UnknownRover("infant", "UTM-X001S", DbcLayout(), Geometry(0.125, 0.5, 4096.0, 0.3)),
    UnknownRover("odrive", "UST-20LX", _preset("odrive", 0), Geometry(0.0825, 0.42, 4096.0, 0.25)),
    UnknownRover("cia402", "UTM-30LX", _preset("cia402", 1), Geometry(0.15, 0.55, 163840.0, 0.35)),
    UnknownRover(
        "vesc_backwards", "UST-20LX", _preset("vesc", 10), Geometry(0.1, 0.4, 798.0, -0.2, laser_backwards=True)
    ),
    UnknownRover(
        "odrive_upside_down",
        "UTM-30LX",
        _preset("odrive", 3),
        Geometry(0.1, 0.45, 4096.0, 0.2, laser_upside_down=True),
    ),
)
