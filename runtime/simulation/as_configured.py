"""A simulated rover that is built as a configuration says: its wheels, their layout and the mount of its laser."""

from drivers.settings.simulated_laser import LaserModel, SimulatedLaserSettings
from drivers.settings.simulated_wheels import SimulatedWheelSettings
from drivers.settings.simulated_world import DriveSettings, LaserGeometrySettings, Place, WorldSettings
from drivers.settings.simulation import SimulationSettings
from runtime.errors import ConfigurationError
from runtime.settings.configuration import Configuration


def simulation_of(
    configuration: Configuration, model: LaserModel = "UTM-30LX", place: Place = "park"
) -> SimulationSettings:
    """Its own [simulation] where it has one, else a rover with this laser in this place, just as it is described.

    Raises ConfigurationError for vehicles that the simulator does not have.
    """
    if configuration.simulation is not None:
        return configuration.simulation
    vehicle, mount, encoders = configuration.vehicle, configuration.slam.mount, configuration.encoders
    if encoders is None or vehicle.motion_model != "differential":
        raise ConfigurationError("a simulated rover needs [encoders] and vehicle.motion_model = 'differential'")
    radius_m = 0.5 * (vehicle.wheel_radius_left_m + vehicle.wheel_radius_right_m)
    laser = LaserGeometrySettings(body_from_laser=(mount.x_m, mount.y_m, mount.yaw_rad), upside_down=mount.upside_down)
    return SimulationSettings(
        world=WorldSettings(place=place, drive=DriveSettings(tread_m=vehicle.tread_m), laser=laser),
        laser=SimulatedLaserSettings(model=model),
        wheels=SimulatedWheelSettings(
            counts_per_rev=vehicle.counts_per_rev,
            wheel_radius_m=radius_m,
            left_radius_factor=vehicle.wheel_radius_left_m / radius_m,
            right_radius_factor=vehicle.wheel_radius_right_m / radius_m,
            period_ms=encoders.period_ms,
        ),
    )
