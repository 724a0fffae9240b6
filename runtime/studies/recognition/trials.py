"""Places in made worlds that are recognised, and attempts that must come to nothing; what an attempt costs."""

import time

import numpy as np

from drivers.measurements import FloatArray
from runtime.studies.jobs import Result
from runtime.studies.recognition.constellations import SCALE, mapped, scattered, seen_from, somewhere
from slam.pose import Pose2
from slam.recognise.attempt import Attempt, Hypothesis, LocalPoints, recognise
from slam.recognise.map_index import MapIndex, index_of
from slam.recognise.warm_up import warm_up_recognition

CUT_OUT_M = 30.0  # around every local point, of a map that has this place no more
RIGHT_M = 1.0
GRID_M = 5.0
JITTERS_M = {"orchard, 0.1 m": 0.1, "orchard, 0.3 m": 0.3}
KINDS = ("scattered", "in clumps", *JITTERS_M)


def things_of(kind: str, generator: np.random.Generator, count: int) -> FloatArray:
    """(count, 2) positions; an orchard stands on a grid, up to its jitter."""
    if kind in JITTERS_M:
        side = round(count**0.5)
        grid = GRID_M * np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
        return grid + JITTERS_M[kind] * generator.standard_normal(grid.shape)
    things = scattered(generator, count)
    if kind == "in clumps":
        middles = things[: count // 6]
        things = middles[np.arange(count) % len(middles)] + 4.0 * generator.standard_normal((count, 2))
        things = things - things.min(axis=0)
    return things


def recognition_trial(kind: str, seed: int, count: int, places: int, code: str) -> Result:  # noqa: ARG001
    """Of one world with `count` things: how many of the places were recognised, rightly and wrongly, and the odds of
    every null attempt: mirrored, of another world, with the place cut out of the map.
    """
    generator = np.random.default_rng(seed)
    things, others = things_of(kind, generator, count), things_of(kind, generator, count)
    index = mapped(generator, things)
    right, wrong, accepted = 0, 0, 0
    nulls: list[float] = []
    for _ in range(places):
        pose = somewhere(generator, things)
        points = seen_from(generator, pose, things)
        found = recognise(index, points)
        is_right = _distance_m(pose, found) < RIGHT_M
        right, wrong = right + (found.acceptable and is_right), wrong + (found.acceptable and not is_right)
        elsewhere = recognise(index, seen_from(generator, somewhere(generator, others), others))
        gone = recognise(_without(index, pose, points), points)
        accepted += elsewhere.acceptable + gone.acceptable
        nulls += [found.mirror_odds, elsewhere.odds, elsewhere.mirror_odds, gone.odds, gone.mirror_odds]
    return {
        "kind": kind,
        "places": places,
        "right": int(right),
        "wrong": int(wrong),
        "null_accepted": int(accepted),
        "null_odds": [round(odds, 2) for odds in nulls if np.isfinite(odds)],
        "nulls": len(nulls),
    }


def cost_trial(count: int, seed: int, attempts: int, code: str) -> Result:  # noqa: ARG001
    """CPU time of an attempt and its mirror image in a map of `count` landmarks, and of the longest slice."""
    warm_up_recognition()
    generator = np.random.default_rng(seed)
    things = scattered(generator, count)
    began_s = time.process_time()
    index = mapped(generator, things)
    indexed = index.indexed
    prepared_s = time.process_time() - began_s
    wholes_ms, slices_ms = [], []
    for _ in range(attempts):
        points = seen_from(generator, somewhere(generator, things), things)
        began_s = time.process_time()
        attempt, found = Attempt(SCALE, indexed, points), None
        slices_s = [began_s]
        while found is None:
            found = attempt.advance()
            slices_s.append(time.process_time())
        wholes_ms.append(1e3 * (slices_s[-1] - began_s))
        slices_ms += (1e3 * np.diff(slices_s)).tolist()
    return {
        "landmarks": count,
        "pairs": len(indexed.pairs.lengths_m),
        "prepared_s": round(prepared_s, 3),
        "attempt_ms": round(float(np.median(wholes_ms)), 2),
        "attempt_p95_ms": round(float(np.quantile(wholes_ms, 0.95)), 2),
        "slice_p99_ms": round(float(np.quantile(slices_ms, 0.99)), 2),
    }


def _distance_m(pose: Pose2, found: Hypothesis) -> float:
    return float(np.hypot(pose.x_m - found.map_from_body.x_m, pose.y_m - found.map_from_body.y_m))


def _without(index: MapIndex, pose: Pose2, points: LocalPoints) -> MapIndex:
    """The map without everything near the points."""
    indexed = index.indexed
    rows = np.flatnonzero(indexed.identities >= 0)
    seen = pose.transform(points.points_m)
    known = indexed.grid.points_m[rows]
    apart = np.array([np.hypot(*(seen - at).T).min() for at in known])
    kept = apart > CUT_OUT_M
    return index_of(SCALE, indexed.identities[rows[kept]], known[kept])
