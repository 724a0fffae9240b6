"""The simulated world that the settings name."""

import math

from drivers.settings.simulated_world import DriveSettings, KidnapSettings, WorldSettings
from drivers.simulated.world.kidnapping import KidnappedPath
from drivers.simulated.world.places.building import Building, building_settings
from drivers.simulated.world.places.world import World
from drivers.simulated.world.rover_path import RoverPath


def world_of(settings: WorldSettings) -> World | Building:
    """The world and the rover's way through it, kidnappings included."""
    if settings.place == "building":
        ring = building_settings(settings.seed).drive
        corners = {"corners_m": ring.corners_m, "corner_m": ring.corner_m, "course_scale": 1.0}
        settings = settings.model_copy(update={"drive": settings.drive.model_copy(update=corners)})
        return Building(settings, _path(settings.drive, settings))
    return World(settings, _path(settings.drive, settings))


def kidnapped(path: RoverPath, kidnap: KidnapSettings) -> RoverPath:
    """The path with one kidnapping more, later than those that it has."""
    return KidnappedPath(path, kidnap.start_s, (kidnap.x_m, kidnap.y_m), math.radians(kidnap.turn_deg))


def _path(drive: DriveSettings, settings: WorldSettings) -> RoverPath:
    path = RoverPath(drive)
    for kidnap in settings.kidnaps:
        path = kidnapped(path, kidnap)
    return path
