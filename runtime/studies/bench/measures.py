"""The speeds that the project holds itself to, each printed with its spread by `infant bench`.

Times are of the processor (CPU time of the one thread that works): what else the machine does falls out of them.
"""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from drivers.measurements import FloatArray, Scan, WheelCounts, uniform_bearings
from drivers.settings.simulated_world import WorldSettings
from drivers.simulated.world.places.world import World
from runtime.settings.configuration import Configuration
from runtime.studies.bench.figure import BenchFigure, spread
from runtime.studies.bench.plain import plain_resample, plain_step
from runtime.studies.bench.recognising import recognising
from runtime.studies.bench.replaying import times_real_time
from runtime.studies.bench.scene import THICKET_PER_M2, Scene
from slam.estimator import Estimator
from slam.front_end.deskew import Twist
from slam.front_end.front_ends import make_front_end
from slam.observations import MOST_FEATURES
from slam.particles.resampling import adopt_maps, parents_in_place, systematic_copies
from slam.pose import Pose2
from slam.settings.slam import MountSettings, SlamSettings

REPEATS, SETTLING, TURNS = 150, 150, 10
DRIVE_S = 20.0
TICK_NS = 100_000_000
COUNTS_PER_M = 4096.0 / (2.0 * np.pi * 0.125)
DRIVEN = SlamSettings(particles=100, mount=MountSettings(x_m=0.3))


def measures() -> Iterator[BenchFigure]:
    """All of them, one after the other; two to three minutes."""
    Estimator.warm_up()
    scene = Scene(100, 1000, 30)
    step_100, joint = filter_steps(scene)
    plain = min(plain_step(scene.particles, scene.next_scan()[1]) for _ in range(3))
    yield BenchFigure("step_m100_n1000_k30", *spread(step_100))
    yield BenchFigure("joint_n1000_k30", *spread(joint))
    yield BenchFigure("plain_numpy_over_step_m100_n1000_k30", round(plain / float(np.median(step_100)), 1), "ratio")
    thicket = filter_steps(Scene(100, 1000, MOST_FEATURES, THICKET_PER_M2))
    yield BenchFigure("step_and_joint_m100_thicket", *spread(thicket[0] + thicket[1]))
    large = Scene(1000, 1000, 30)
    yield BenchFigure("step_m1000_n1000_k30", *spread(filter_steps(large)[0]))
    yield from resampling(large)
    yield from growth()
    yield from map_memory(scene)
    yield from recognising()
    scans = drive_scans()
    yield BenchFigure("front_end_1081", *spread(front_end_times(scans)))
    yield BenchFigure("tick_m100", *spread(tick_times(scans)))
    speeds = [times_real_time(scans, Configuration(slam=DRIVEN)) for _ in range(3)]
    yield BenchFigure("replay_speed", round(float(np.median(speeds)), 1), "times real time")
    yield start_warm()


def timed_ms(work: Callable[[], object]) -> float:
    """CPU time of one call."""
    began_ns = time.thread_time_ns()
    work()
    return (time.thread_time_ns() - began_ns) * 1e-6


def filter_steps(scene: Scene, settling: int = SETTLING, repeats: int = REPEATS) -> tuple[FloatArray, FloatArray]:
    """Times of the particles' step and of the joint Gaussian's, ms."""
    particles, joint = [], []
    for _ in range(settling):  # a map that was just made lets go of what is far away, some landmarks a scan
        scene.step(*scene.next_scan())
    for _ in range(repeats):
        increment, features = scene.next_scan()
        began_ns = time.thread_time_ns()
        outcome = scene.particles.step(increment, features)
        between_ns = time.thread_time_ns()
        scene.joint.step(increment.mean, increment.covariance, features, outcome.matches)
        particles.append((between_ns - began_ns) * 1e-6)
        joint.append((time.thread_time_ns() - between_ns) * 1e-6)
    return np.array(particles), np.array(joint)


def resampling(scene: Scene) -> Iterator[BenchFigure]:
    """Taking over the maps of survivors, against copying dense arrays."""
    rng = np.random.default_rng(1)
    count = len(scene.particles.poses)

    def resample() -> None:
        weights = rng.exponential(size=count)
        adopt_maps(scene.particles.store.pages, parents_in_place(systematic_copies(weights / weights.sum(), 0.5)))

    times = np.array([timed_ms(resample) for _ in range(REPEATS)])
    yield BenchFigure("resample_m1000_n1000", *spread(times))
    plain = plain_resample(count, 1000, rng)
    yield BenchFigure("plain_numpy_over_resample_m1000_n1000", round(plain / float(np.median(times)), 1), "ratio")


def growth() -> Iterator[BenchFigure]:
    """Median of a whole step, joint Gaussian included, with 20 000 landmarks in the map over that with 200.

    The two take turns, so that both meet the same company on the machine.
    """
    scenes = [Scene(100, landmarks, 30) for landmarks in (200, 20_000)]
    times: list[list[FloatArray]] = [[], []]
    for turn in range(TURNS):
        for scene, spent in zip(scenes, times, strict=True):
            particles, joint = filter_steps(scene, SETTLING if turn == 0 else 5, REPEATS // TURNS)
            spent.append(particles + joint)
    small, large = (float(np.median(np.concatenate(spent))) for spent in times)
    yield BenchFigure("growth_n20000_over_n200", round(large / small, 3), "ratio")


def map_memory(scene: Scene) -> Iterator[BenchFigure]:
    """Bytes that the map takes for each particle and landmark, after driving with real resampling."""
    store = scene.particles.store
    mapped = len(scene.particles.poses) * store.count_of(scene.particles.best)
    yield BenchFigure("bytes_per_particle_landmark", round(store.used_bytes() / mapped, 1), "bytes")
    yield BenchFigure("allocated_bytes_per_particle_landmark", round(store.allocated_bytes() / mapped, 1), "bytes")


def drive_scans() -> list[tuple[int, Scan, WheelCounts, Pose2]]:
    """A drive through the simulated park: stamp, scan, wheels and true pose of each tick."""
    world = World(WorldSettings())
    laser = world.settings.laser
    bearings = uniform_bearings(laser.first_bearing_rad, laser.beam_spacing_rad, laser.beam_count)
    rows = []
    for tick in range(round(DRIVE_S * 10)):
        now_ns = tick * TICK_NS
        ranges = world.ranges_at(now_ns)
        scan = Scan(
            now_ns, np.where(np.isfinite(ranges), ranges, np.nan).astype(np.float32), bearings, laser.beam_period_s
        )
        left_m, right_m = world.wheel_travel_m(now_ns)
        wheels = WheelCounts(now_ns, left_m * COUNTS_PER_M, right_m * COUNTS_PER_M)
        rows.append((now_ns, scan, wheels, Pose2(*world.map_from_body(now_ns))))
    return rows


def front_end_times(rows: list[tuple[int, Scan, WheelCounts, Pose2]]) -> FloatArray:
    """Each scan of the drive through the default front end, ms."""
    settings = SlamSettings()
    front_end = make_front_end(settings.front_end, difference=True, sparse=True, body_from_laser=Pose2(0.3, 0.0, 0.0))
    twist = Twist(0.5, 0.0, 0.0)
    return np.array([timed_ms(partial(front_end.observe, scan, pose, twist, False)) for _, scan, _, pose in rows])


def tick_times(rows: list[tuple[int, Scan, WheelCounts, Pose2]]) -> FloatArray:
    """Whole ticks without sinks, 100 particles, ms."""
    estimator = Estimator(DRIVEN, 1)
    return np.array([timed_ms(partial(estimator.step, now, scan, (wheels,))) for now, scan, wheels, _ in rows])


def start_warm() -> BenchFigure:
    """From the start of a process to the end of its first tick, with a warm compile cache, s of the wall clock."""
    program = (
        "import runtime.live.parts, runtime.live.run\n"
        "from slam.estimator import Estimator\nfrom slam.settings.slam import SlamSettings\n"
        "Estimator.warm_up(SlamSettings())\n"
        "Estimator(SlamSettings(), 1).step(0, None, ())\n"
    )
    times = []
    for _ in range(5):
        began_s = time.monotonic()
        subprocess.run([sys.executable, "-c", program], check=True, start_new_session=True)
        times.append(time.monotonic() - began_s)
    return BenchFigure("start_warm", round(float(np.median(times)), 2), "s", round(max(times), 2))
