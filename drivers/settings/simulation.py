"""The simulated rover as one table of the configuration: its world, its laser, its wheel node."""

from pydantic import BaseModel, ConfigDict, Field

from drivers.settings.simulated_laser import SimulatedLaserSettings
from drivers.settings.simulated_wheels import SimulatedWheelSettings
from drivers.settings.simulated_world import WorldSettings


class SimulationSettings(BaseModel):
    """Present only where the rover is simulated; a real rover's configuration has no such table."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    world: WorldSettings = Field(default_factory=WorldSettings)
    laser: SimulatedLaserSettings = Field(default_factory=SimulatedLaserSettings)
    wheels: SimulatedWheelSettings = Field(default_factory=SimulatedWheelSettings)
