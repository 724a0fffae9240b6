"""Fields of the models that no file sets: the geometry handed on from [vehicle], and parameters of our own parts."""

from typing import Any

from pydantic import BaseModel

from drivers.settings.simulated_laser import SimulatedLaserSettings
from drivers.settings.simulated_wheels import SimulatedWheelSettings
from drivers.settings.simulated_world import DriveSettings, WorldSettings
from drivers.settings.vehicle import VehicleSettings
from drivers.settings.wheel_signals import WheelSignals
from runtime.settings.review import ReviewSettings
from slam.settings.odometry import OdometrySettings
from slam.settings.slam import SlamSettings

SHARED = frozenset(VehicleSettings.model_fields) & set(OdometrySettings.model_fields)
HANDED_ON = {"slam.odometry": SHARED | {"model", "jump_speed_mps"}, "encoders": frozenset({"vehicle"})}
"""By table: filled from [vehicle]."""
DEVICE = frozenset({"frame_id", "status_mask", "crc_polynomial", "crc_init", "crc_xor_out", "crc_over_id", "info"})
INTERNAL: dict[str, tuple[type[BaseModel], frozenset[str]]] = {
    "encoders.layout.left": (WheelSignals, DEVICE),
    "encoders.layout.right": (WheelSignals, DEVICE),
    "slam": (SlamSettings, frozenset({"resample_share"})),
    "review": (ReviewSettings, frozenset({"scan_every"})),
    "simulation.world": (
        WorldSettings,
        frozenset(WorldSettings.model_fields) - {"seed", "place", "people", "kidnaps", "drive"},
    ),
    "simulation.world.drive": (DriveSettings, frozenset(DriveSettings.model_fields) - {"speed_mps"}),
    "simulation.laser": (
        SimulatedLaserSettings,
        frozenset(SimulatedLaserSettings.model_fields) - {"model", "host", "port", "pty", "faults"},
    ),
    "simulation.wheels": (
        SimulatedWheelSettings,
        frozenset(SimulatedWheelSettings.model_fields) - {"slip_std_per_m", "faults"},
    ),
}
"""By table: its model, and the fields that programs only set, such as tests and studies of another park."""
NOT_KEYS = HANDED_ON | {path: names for path, (_, names) in INTERNAL.items()}


def excluded() -> dict[str, Any]:
    """All of them as pydantic takes them when it writes a configuration down."""
    tree: dict[str, Any] = {}
    for path, names in NOT_KEYS.items():
        table = tree
        for part in path.split("."):
            table = table.setdefault(part, {})
        table |= dict.fromkeys(names, True)
    return tree
