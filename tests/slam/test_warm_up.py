"""After the warm-up nothing is compiled any more: a compilation inside the loop costs seconds."""

import pkgutil
import subprocess
import sys
from dataclasses import replace
from importlib import import_module

from numba.core.dispatcher import Dispatcher

import slam
from drivers.measurements import Scan
from slam.estimator import Estimator
from slam.settings.slam import SlamSettings
from slam.warm_up import warm_up_drive, warm_up_settings

# In a process of its own: what other tests have compiled must not hide what the warm-up left out.
DRIVE = """
import numpy as np
from drivers.measurements import OdometryPose, Scan, Sightings, WheelCounts, uniform_bearings
from drivers.simulated.world.places.world import World
from drivers.settings.simulated_world import WorldSettings
from slam.estimator import Estimator
from slam.settings.slam import SlamSettings
from tests.slam.test_warm_up import compiled_signatures

def in_the_park():
    world = World(WorldSettings())
    estimator = Estimator(SlamSettings(particles=5, resample_share=1.0), 1)
    bearings = uniform_bearings(-0.75 * np.pi, np.pi / 720, 1081)
    for tick in (*range(60), 100):
        now = tick * 100_000_000
        left, right = (5215.2 * metres for metres in world.wheel_travel_m(now))
        ranges = world.ranges_at(now)
        scan = Scan(now, np.where(np.isfinite(ranges), ranges, np.nan).astype(np.float32), bearings, 7e-5)
        estimator.step(now, scan, (WheelCounts(now, left, right),))

def to_the_horizon_and_back():
    given = {"kind": "given"}
    settings = SlamSettings.model_validate(
        {"particles": 2, "front_end": given, "odometry": {"model": "pose"}, "joint": {"landmarks_in_state": 8}}
    )
    estimator, generator, now = Estimator(settings, 1), np.random.default_rng(1), 0
    things = generator.uniform((-20.0, -10.0), (220.0, 10.0), (150, 2))
    for x in (*np.linspace(0.0, 200.0, 120), *np.linspace(200.0, 0.0, 120)):
        now += 100_000_000
        offsets = things - (x, 0.0)
        near = offsets[np.hypot(*offsets.T) < 20.0]
        ranges, bearings = np.hypot(*near.T), np.arctan2(near[:, 1], near[:, 0])
        seen = Sightings(now, ranges, bearings, np.full(len(near), -1))
        estimator.step(now, seen, (OdometryPose(now, float(x), 0.0, 0.0),))

Estimator.warm_up(SlamSettings())
before = compiled_signatures()
in_the_park()
to_the_horizon_and_back()
late = sorted(compiled_signatures() - before)
assert before
assert not late, "\\n".join(" ".join(row) for row in late)
"""


def compiled_signatures() -> set[tuple[str, str, str]]:
    """(module, kernel, signature) of everything compiled in this process."""
    found = set()
    for info in pkgutil.iter_modules(slam.__path__):
        for name, value in vars(import_module(f"slam.{info.name}")).items():
            if isinstance(value, Dispatcher):
                found |= {(value.py_func.__module__, name, str(signature)) for signature in value.signatures}
    return found


def test_a_drive_compiles_nothing_that_the_warm_up_has_not() -> None:
    result = subprocess.run([sys.executable, "-c", DRIVE], capture_output=True, text=True, timeout=1000, check=False)
    assert result.returncode == 0, result.stderr[-3000:]


def bearing_variance(beam_period_s: float) -> float:
    """Mean over the features of the last scan of the warm-up's drive, which moves."""
    settings = warm_up_settings(
        SlamSettings.model_validate({"front_end": {"sigma_bearing_floor_rad": 0.0005}}), "robust"
    )
    estimator = Estimator(settings, 1)
    for stamp_ns, scan, wheels in warm_up_drive(settings):
        assert isinstance(scan, Scan)
        estimate = estimator.step(stamp_ns, replace(scan, beam_period_s=beam_period_s), wheels)
    assert estimate.features is not None
    return float(estimate.features.covariances[:, 1, 1].mean())


def test_the_estimator_widens_features_by_the_motion_within_the_sweep() -> None:
    assert bearing_variance(1e-4) > 1.5 * bearing_variance(0.0)
