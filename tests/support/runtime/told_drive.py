"""A drive as a filter was told of it, made without one: two rounds among posts, with true places and noise."""

from dataclasses import replace

import numpy as np

from drivers.measurements import FloatArray
from runtime.smooth.sightings import DriveTold, Fits, Sightings
from slam.pose import composed, inverted, wrap_rads

SCANS, STEP_S = 160, 0.5
POSTS = 30
MOUNT = np.array((0.3, 0.1, 0.2))
RANGE_M, BEARING_RAD = 0.05, 0.01  # true noise; the configured one is four times as large
CONFIGURED = 4.0
STEP = np.array((0.05, 0.02, 0.01))
VIEW_M = 12.0


def true_path() -> FloatArray:
    """(n, 3) two rounds of a circle of 10 m."""
    angles = np.linspace(0.0, 4.0 * np.pi, SCANS)
    circle = np.column_stack((10.0 * np.sin(angles), 10.0 * (1.0 - np.cos(angles)), wrap_rads(angles)))
    return np.asarray(circle, dtype=np.float64)


def told_drive(seed: int = 0) -> tuple[DriveTold, FloatArray]:
    """The drive, and where the posts are (l, 2); their numbers are their identities."""
    rng = np.random.default_rng(seed)
    truth = true_path()
    posts = np.column_stack((rng.uniform(-16.0, 16.0, POSTS), rng.uniform(-6.0, 26.0, POSTS)))
    motions = composed(inverted(truth[:-1]), truth[1:]) + rng.normal(0.0, STEP, (SCANS - 1, 3))
    motions = np.vstack((np.zeros((1, 3)), motions))
    motions[:, 2] = wrap_rads(motions[:, 2])
    rows = []
    for number, laser in enumerate(composed(truth, MOUNT)):
        off = posts - laser[:2]
        ranges, bearings = np.hypot(*off.T), wrap_rads(np.arctan2(off[:, 1], off[:, 0]) - laser[2])
        for post in np.flatnonzero((ranges < VIEW_M) & (np.abs(bearings) < 2.0)).tolist():
            seen = ranges[post] + rng.normal(0.0, RANGE_M), bearings[post] + rng.normal(0.0, BEARING_RAD)
            rows.append((number, post, *seen))
    columns = np.array(rows)
    rr, bb = (np.full(len(rows), (CONFIGURED * sigma) ** 2) for sigma in (RANGE_M, BEARING_RAD))
    scans, identities = columns[:, 0].astype(np.int64), columns[:, 1].astype(np.int64)
    odometry = [np.zeros(3)]
    for motion in motions[1:]:
        odometry.append(composed(odometry[-1], motion))
    filtered = truth + np.vstack((np.zeros((1, 3)), rng.normal(0.0, (0.05, 0.05, 0.01), (SCANS - 1, 3))))
    stamps_s: FloatArray = np.asarray(100.0 + STEP_S * np.arange(SCANS), dtype=np.float64)
    told = DriveTold(
        stamps_s=stamps_s,
        motions=motions,
        motion_covariances=np.tile(np.diag(STEP**2), (SCANS, 1, 1)),
        odometry=np.array(odometry),
        filtered=filtered,
        covariances=np.tile(np.diag((0.05, 0.05, 0.01)) ** 2, (SCANS, 1, 1)),
        known=np.ones(SCANS, dtype=np.bool_),
        start=filtered,
        sightings=Sightings(scans, identities, columns[:, 2], columns[:, 3], rr, np.zeros(len(rows)), bb),
        fits=Fits(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3))),
        ticks=np.column_stack((stamps_s, np.array(odometry))),
        body_from_laser=MOUNT,
        final=np.unique(identities),
    )
    return told, posts


def with_identities(told: DriveTold, identities: np.typing.NDArray[np.int64]) -> DriveTold:
    """The same with other landmarks seen."""
    seen = replace(told.sightings, identities=identities)
    return replace(told, sightings=seen, final=np.unique(identities))
