"""What ROS 2 messages need to know of a rover that stands in no tick: geometry, noise, and names of its frames."""

from dataclasses import dataclass, field

from runtime.settings.configuration import Configuration
from slam.settings.odometry import OdometrySettings
from slam.settings.slam import MountSettings


@dataclass(frozen=True, slots=True)
class Frames:
    """Names of the frames of REP 105, each behind the prefix of its rover, so that two rovers do not share one tree."""

    prefix: str = ""

    def __call__(self, frame: str) -> str:
        """map, odom, base_link, laser or truth as the messages name it."""
        return f"{self.prefix}/{frame}" if self.prefix else frame


PLAIN = Frames()


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Facts of one rover's configuration.

    scan_period_s: from one scan to the next. range_min_m: nearer returns are none.
    """

    mount: MountSettings = field(default_factory=MountSettings)
    odometry: OdometrySettings = field(default_factory=OdometrySettings)
    scan_period_s: float = 0.1
    range_min_m: float = 0.1
    frames: Frames = PLAIN

    @classmethod
    def of(cls, configuration: Configuration, frames: Frames = PLAIN) -> "Vehicle":
        """Of a configuration; without a laser the rate of the loop stands for its rate."""
        laser, slam = configuration.laser, configuration.slam
        rate_hz = configuration.loop.rate_hz if laser is None else laser.rate_hz
        return cls(slam.mount, slam.odometry, 1.0 / rate_hz, slam.front_end.range_min_m, frames)
