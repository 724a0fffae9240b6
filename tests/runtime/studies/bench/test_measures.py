"""Speed as ratios and counts: what the machine does besides does not show in them."""

from functools import partial

import numpy as np
import pytest

from runtime.studies.bench.measures import map_memory, timed_ms
from runtime.studies.bench.plain import plain_step
from runtime.studies.bench.recognising import park_map, points_around, slices_ms
from runtime.studies.bench.scene import THICKET_PER_M2, Scene
from slam.estimator import Estimator
from slam.observations import MOST_FEATURES
from slam.recognise.warm_up import warm_up_recognition

SCANS = 15


def median_ms(scene: Scene) -> float:
    """CPU time of the particles' step."""
    times = []
    for _ in range(SCANS):
        times.append(timed_ms(partial(scene.particles.step, *scene.next_scan())))
    return float(np.median(times))


def test_the_compiled_step_is_a_hundred_times_faster_than_plain_numpy() -> None:
    """Seven hundred times on an idle core; counting references in the inner kernels alone takes a third of that."""
    Estimator.warm_up()
    scene = Scene(50, 400, 30)
    step_ms = median_ms(scene)
    assert plain_step(scene.particles, scene.next_scan()[1]) > 100.0 * step_ms


def test_a_thicket_costs_no_more_than_some_ordinary_steps() -> None:
    """As many landmarks around as a scan may show, and as many of them seen as are matched: 256 cost 80 times."""
    Estimator.warm_up()
    ordinary, thicket = Scene(50, 400, 30), Scene(50, 400, MOST_FEATURES, THICKET_PER_M2)
    assert median_ms(thicket) < 12.0 * median_ms(ordinary)


@pytest.fixture(scope="module")
def surveyed() -> Scene:
    """A field of a thousand."""
    return Scene(3, 1000, 30)


def test_the_joint_state_of_a_surveyed_field_is_bounded_by_the_window_and_not_by_the_map(surveyed: Scene) -> None:
    assert surveyed.joint.landmark_count > 950
    assert surveyed.particles.store.count_of(0) > 950
    assert surveyed.joint.landmarks_in_state < 300


def test_a_step_looks_at_as_many_landmarks_in_a_large_map_as_in_a_small_one(surveyed: Scene) -> None:
    evaluated = []
    for scene in (Scene(3, 200, 30), surveyed):
        outcomes = [scene.particles.step(*scene.next_scan()) for _ in range(SCANS)]
        evaluated.append(sum(outcome.likelihoods for outcome in outcomes) / SCANS / 3)
    assert 20.0 < evaluated[0] < 45.0
    assert abs(evaluated[1] - evaluated[0]) < 0.1 * evaluated[0]


def test_shared_pages_take_a_fraction_of_what_a_map_for_each_particle_would() -> None:
    """A map of its own for each particle takes 56 bytes a landmark."""
    scene = Scene(50, 400, 30)
    for _ in range(8 * SCANS):  # until survivors have been copied some times
        scene.step(*scene.next_scan())
    used, allocated = map_memory(scene)
    assert 0.0 < used.value < 60.0
    assert allocated.value >= used.value


def test_looking_in_a_large_map_takes_more_slices_and_not_longer_ones() -> None:
    """All at once, the attempt in 5000 landmarks would take twenty times as long as that in 200."""
    warm_up_recognition()
    rng = np.random.default_rng(1)
    spent = []
    for size in (200, 5000):
        means_m, index = park_map(size, rng)
        points = points_around(means_m, rng)
        spent.append(min((slices_ms(index, points) for _ in range(5)), key=max))
    small, large = spent
    assert len(large) > 2 * len(small)
    assert max(large) < 8.0 * max(small)
