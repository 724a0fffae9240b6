"""An estimator of ten lines with the same door as the real one: replay is tested without the filter's weight."""

import hashlib

import numpy as np

from drivers.measurements import ScanLike, SpeedSteering, WheelCounts, WheelSample
from runtime.messages.tick import encode_tick
from runtime.tick import Tick
from slam.estimate import Estimate, Quality
from slam.pose import Pose2
from slam.recognise.prior import PosePrior
from slam.settings.slam import SlamSettings


class SmallEstimator:
    """Its pose and hash depend on every bit of every input, on the seed and on the number of particles."""

    def __init__(self, settings: SlamSettings, seed: int) -> None:
        self._hash = hashlib.blake2b(f"{seed} {settings.particles}".encode(), digest_size=16).digest()
        self._x_m = 0.0
        self.wrong_at_ns: int | None = None

    def step(
        self, stamp_ns: int, scan: ScanLike | None, wheels: tuple[WheelSample, ...], told: PosePrior | None = None
    ) -> Estimate:
        seen = b"" if scan is None else scan.ranges_m.tobytes() + scan.bearings_rad.tobytes()
        digest = hashlib.blake2b(self._hash + encode_tick(Tick(0, stamp_ns, None, wheels)).data + seen, digest_size=16)
        self._hash = digest.digest()
        self._x_m += sum(abs(_forward(sample)) for sample in wheels)
        if stamp_ns == self.wrong_at_ns:
            self._x_m = float(np.nextafter(self._x_m, np.inf))
        pose = Pose2(self._x_m, 0.5, 0.1)
        return Estimate(stamp_ns, pose, np.eye(3), pose, np.eye(3), pose, Quality.TRACKING, counts={"landmarks": 4.0})

    def state_hash(self) -> bytes:
        return self._hash


def _forward(sample: WheelSample) -> float:
    if isinstance(sample, WheelCounts):
        return sample.left
    return sample.speed_mps if isinstance(sample, SpeedSteering) else 1.0
