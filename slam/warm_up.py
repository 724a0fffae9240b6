"""Settings and a short drive that make every kernel of the estimator compile."""

from collections.abc import Iterator

import numpy as np

from drivers.measurements import OdometryPose, Sightings, SpeedSteering, SpeedYawRate, WheelCounts, WheelSample
from slam.settings import SlamSettings

RINGS_M = np.array((4.0, 6.0, 9.0, 12.0))
BEARINGS_RAD = np.array((-1.0, 0.2, 0.9, -0.4))
TICK_NS = 100_000_000


def warm_up_settings(settings: SlamSettings) -> SlamSettings:
    """The same filter with few particles that resample in every scan, and features given."""
    tree = settings.model_dump()
    tree |= {"particles": 4, "resample_share": 1.0}
    tree["front_end"] = {"kind": "given"}
    return SlamSettings.model_validate(tree)


def warm_up_drive(settings: SlamSettings) -> Iterator[tuple[int, Sightings, tuple[WheelSample, ...]]]:
    """Stamps, sightings of four things and wheel samples of a drive of half a second."""
    for tick in range(1, 6):
        stamp_ns = tick * TICK_NS
        moved = 0.05 * max(tick - 2, 0)
        identities = np.arange(4) if settings.association.strategy == "known" else np.full(4, -1)
        sightings = Sightings(stamp_ns, RINGS_M - moved, BEARINGS_RAD.copy(), identities)
        yield stamp_ns, sightings, (_wheel_sample(settings, stamp_ns, moved),)


def _wheel_sample(settings: SlamSettings, stamp_ns: int, moved_m: float) -> WheelSample:
    """A sample of the kind that the configured motion model takes."""
    speed = 0.5 if moved_m > 0.0 else 0.0
    if settings.odometry.model == "steered":
        return SpeedSteering(stamp_ns, speed, 0.05)
    if settings.odometry.model == "speed_yaw_rate":
        return SpeedYawRate(stamp_ns, speed, 0.05 * speed)
    if settings.odometry.model == "pose":
        return OdometryPose(stamp_ns, moved_m, 0.0, 0.0)
    return WheelCounts(stamp_ns, 5000.0 * moved_m, 5200.0 * moved_m)
