from itertools import pairwise
from unittest.mock import Mock

import numpy as np
import pytest

from drivers.measurements import Scan, uniform_bearings
from drivers.settings.simulated_world import WorldSettings
from drivers.simulated.world.places.world import World
from runtime.calibrate.scans import match as module
from runtime.calibrate.scans.match import GATES_M, ROUNDS, match
from runtime.calibrate.scans.shapes import Shapes, shapes
from slam.pose import composed, inverted

STEP_S = 1.0


def _seen(world: World, time_s: float) -> tuple[Shapes, np.ndarray]:
    laser = world.settings.laser
    poses = [
        composed(np.array(world.map_from_body(round(time * 1e9))), np.array(laser.body_from_laser))
        for time in (time_s, time_s - 0.01, time_s + 0.01)
    ]
    ranges = world.ranges_at(round(time_s * 1e9)).astype(np.float32)
    ranges[~np.isfinite(ranges)] = np.nan
    bearings = uniform_bearings(laser.first_bearing_rad, laser.beam_spacing_rad, laser.beam_count)
    scan = Scan(0, ranges, bearings, laser.beam_period_s, 0, laser.range_max_m)
    return shapes(scan, composed(inverted(poses[1]), poses[2]) / 0.02), poses[0]


def _empty() -> Shapes:
    return Shapes(*(np.zeros(shape) for shape in ((0, 2), 0, 0, 0, 0, (0, 2), (0, 2))))


def test_motion_in_a_park_with_people_is_found_and_its_covariance_is_honest() -> None:
    errors, squares = [], []
    for seed in (1, 2, 3):
        world, rng = World(WorldSettings(seed=seed)), np.random.default_rng(seed)
        seen = [_seen(world, time) for time in np.arange(3.0, 43.0, STEP_S)]
        for (before, pose), (after, later) in pairwise(seen):
            truth = composed(inverted(pose), later)
            (found,) = match([before], [after], (truth + rng.normal(0.0, (0.02, 0.02, 0.02)))[None])
            error = found.mean - truth
            errors.append(np.abs(error))
            squares.append(error @ np.linalg.solve(found.covariance, error))
    assert (np.median(errors, axis=0) < (0.006, 0.006, 0.0006)).all()
    assert (np.percentile(errors, 95, axis=0) < (0.03, 0.03, 0.003)).all()
    assert 1.0 < np.median(squares) < 4.0  # 2.4 for a Gaussian


def test_with_nothing_in_common_the_guess_stays_and_nothing_is_claimed() -> None:
    empty = _empty()
    guess = np.array((0.3, 0.1, 0.05))
    (found,) = match([empty], [empty], guess[None])
    np.testing.assert_array_equal(found.mean, guess)
    assert found.pairs == 0
    assert np.diag(found.covariance).min() > 0.5


def test_a_corridor_fixes_everything_but_the_way_along_it() -> None:
    walls = np.array(((2.0, 1.0), (-2.0, 1.0), (4.0, -1.0), (-4.0, -1.0)))
    count = len(walls)
    corridor = Shapes(
        walls,
        np.full(count, 0.5 * np.pi),
        np.full(count, 2.0),
        np.full(count, 1e-5),
        np.full(count, 1e-5),
        np.zeros((0, 2)),
        np.zeros((0, 2)),
    )
    (found,) = match([corridor], [corridor], np.array(((0.1, 0.02, 0.01),)))
    deviations = np.sqrt(np.diag(found.covariance))
    assert deviations[0] > 0.5 > 0.01 > deviations[1]
    np.testing.assert_allclose(found.mean[1:], 0.0, atol=2e-3)


def test_pairs_that_are_matched_together_come_out_as_each_alone_and_in_the_steps_of_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World(WorldSettings(seed=1))
    seen = [*(_seen(world, time)[0] for time in np.arange(3.0, 23.0, STEP_S)), _empty()]
    guesses = np.tile((0.5, 0.0, 0.05), (len(seen) - 1, 1))
    alone = [match([one], [next_], guesses[:1])[0] for one, next_ in pairwise(seen)]
    counted = Mock(wraps=module._edge_residuals)
    monkeypatch.setattr(module, "_edge_residuals", counted)
    together = match(seen[:-1], seen[1:], guesses)
    assert counted.call_count <= len(GATES_M) * ROUNDS  # and not twenty times as many
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_allclose(one.mean, other.mean, atol=1e-12)
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-6)
        assert (one.pairs, one.outlier_share) == (other.pairs, other.outlier_share)
