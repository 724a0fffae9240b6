"""Motion of the laser between two scans, from the shapes that both show; what moved by itself is weighted away.

Many pairs are aligned together, as rows of arrays that NaN fills up: one pair alone costs as much as sixty.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.measurements import BoolArray, FloatArray
from runtime.calibrate.scans.shapes import Shapes
from slam.pose import rotated

GATES_M = (0.6, 0.3, 0.2)  # how far apart shapes of one thing may be: wide at first, the guess comes from the wheels
EDGE_GATE_RAD = 0.2
ROUNDS = 4
ROBUST = 2.4  # deviations at which a residual has a quarter of its weight (Geman and McClure): walkers fall out
UNKNOWN_M, UNKNOWN_RAD = 1.0, 1.0  # a direction that no shape fixes keeps this deviation
TOGETHER = 64  # pairs of scans: more are no faster, and their arrays take memory
X, Y, ANGLE, LENGTH, VARIANCE, ANGLE_VARIANCE = range(6)  # columns of an edge
THING_VARIANCES = slice(2, 4)  # columns of a thing after X and Y: radial, tangential


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """before_from_after of the laser: mean (3,), covariance (3, 3); pairs used; outlier_share: beyond 3 deviations."""

    mean: FloatArray
    covariance: FloatArray
    pairs: int
    outlier_share: float


def match(befores: Sequence[Shapes], afters: Sequence[Shapes], guesses: FloatArray) -> list[Match]:
    """Align each `after` with its `before`; guesses (n, 3) are before_from_after as the wheels say.

    With nothing in common the covariance stays wide.
    """
    found: list[Match] = []
    for begin in range(0, len(guesses), TOGETHER):
        part = slice(begin, begin + TOGETHER)
        found += _matched(befores[part], afters[part], guesses[part])
    return found


def _matched(befores: Sequence[Shapes], afters: Sequence[Shapes], guesses: FloatArray) -> list[Match]:
    before, after, poses = _padded(befores), _padded(afters), guesses.copy()
    prior = np.array((UNKNOWN_M**-2, UNKNOWN_M**-2, UNKNOWN_RAD**-2))
    information = np.tile(np.diag(prior), (len(poses), 1, 1))
    outlier_shares, pairs = np.zeros(len(poses)), np.zeros(len(poses), np.int64)
    for gate in GATES_M:
        edges, things = (
            _paired_edges(before[0], after[0], poses, gate),
            _paired_things(before[1], after[1], poses, gate),
        )
        paired = [np.isfinite(kind[1][..., X]) for kind in (edges, things)]
        used = np.concatenate((paired[0], paired[0], paired[1], paired[1]), axis=1)
        pairs = paired[0].sum(axis=1) + paired[1].sum(axis=1)
        live = np.flatnonzero(pairs)
        for _ in range(ROUNDS):
            if live.size == 0:
                break
            ours = used[live]
            parts = (
                *_edge_residuals(poses[live], *(side[live] for side in edges)),
                *_thing_residuals(poses[live], *(side[live] for side in things)),
            )
            rows = np.where(ours[..., None], np.concatenate(parts, axis=1), 0.0)
            residuals, jacobian = rows[..., 0], rows[..., 1:]
            sizes = np.abs(residuals)
            scale = np.maximum(1.0, 1.4826 * _medians(sizes, ours))[:, None]
            weights = 1.0 / (1.0 + (residuals / (ROBUST * scale)) ** 2) ** 2 / scale**2
            weighted = (jacobian * weights[..., None]).swapaxes(1, 2)
            information[live] = weighted @ jacobian + np.diag(prior)
            gradient = (weighted @ residuals[..., None])[..., 0] + prior * (poses[live] - guesses[live])
            steps = np.linalg.solve(information[live], gradient[..., None])[..., 0]
            poses[live] -= steps
            outlier_shares[live] = (sizes > 3.0 * scale).sum(axis=1) / ours.sum(axis=1)
            live = live[np.abs(steps).max(axis=1) >= 1e-6]
    covariances = np.linalg.inv(information)
    return [Match(*row) for row in zip(poses, covariances, pairs.tolist(), outlier_shares.tolist(), strict=True)]


def _padded(seen: Sequence[Shapes]) -> tuple[FloatArray, FloatArray]:
    """Edges (n, e, 6) and things (n, k, 4) of n scans; rows of NaN, which pair with nothing, fill up what is short."""
    edges = np.full((len(seen), max(len(one.edge_angles_rad) for one in seen), 6), np.nan)
    things = np.full((len(seen), max(len(one.thing_centres_m) for one in seen), 4), np.nan)
    for row, one in enumerate(seen):
        own = edges[row, : len(one.edge_angles_rad)]
        own[:, :2], own[:, ANGLE], own[:, LENGTH] = one.edge_centres_m, one.edge_angles_rad, one.edge_lengths_m
        own[:, VARIANCE], own[:, ANGLE_VARIANCE] = one.edge_variances_m2, one.edge_angle_variances
        things[row, : len(one.thing_centres_m)] = np.hstack((one.thing_centres_m, one.thing_variances_m2))
    return edges, things


def _medians(values: FloatArray, used: BoolArray) -> FloatArray:
    """(n,) of the values (n, m) that are used; at least one in each row."""
    ordered, counts = np.sort(np.where(used, values, np.inf), axis=1), used.sum(axis=1)[:, None]
    middle = np.take_along_axis(ordered, np.hstack(((counts - 1) // 2, counts // 2)), axis=1)
    medians: FloatArray = middle.mean(axis=1)
    return medians


def _placed(points: FloatArray, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points (n, m, 2) in the frame before, and the lever by which a turn moves them."""
    turned = rotated(points, poses[:, 2, None])
    return turned + poses[:, None, :2], np.stack((-turned[..., 1], turned[..., 0]), axis=-1)


def _mutual(before: FloatArray, after: FloatArray, cost: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rows of `before`, and those of `after` that are their pairs, NaN where there are none.

    A pair is each other's cheapest by the cost (n, rows before, rows after); infinite cost pairs with nothing.
    """
    if cost.shape[1] == 0 or cost.shape[2] == 0:
        return before, np.full((*before.shape[:2], after.shape[2]), np.nan)
    best = np.argmin(cost, axis=2)
    back = np.take_along_axis(np.argmin(cost, axis=1), best, axis=1)
    kept = (back == np.arange(cost.shape[1])) & np.isfinite(cost.min(axis=2))
    return before, np.where(kept[..., None], np.take_along_axis(after, best[..., None], axis=1), np.nan)


def _paired_things(
    before: FloatArray, after: FloatArray, poses: FloatArray, gate: float
) -> tuple[FloatArray, FloatArray]:
    placed, _ = _placed(after[..., :2], poses)
    distance = np.hypot(*np.moveaxis(before[:, :, None, :2] - placed[:, None], -1, 0))
    return _mutual(before, after, np.where(distance < gate, distance, np.inf))


def _paired_edges(
    before: FloatArray, after: FloatArray, poses: FloatArray, gate: float
) -> tuple[FloatArray, FloatArray]:
    placed, _ = _placed(after[..., :2], poses)
    angles = (after[..., ANGLE] + poses[:, 2, None])[:, None]
    turned = _half_turn(before[..., ANGLE, None] - angles)
    middle = angles + 0.5 * turned
    cosine, sine = np.cos(middle), np.sin(middle)
    offset_x, offset_y = np.moveaxis(before[:, :, None, :2] - placed[:, None], -1, 0)
    across, along = np.abs(cosine * offset_x + sine * offset_y), np.abs(cosine * offset_y - sine * offset_x)
    reach = 0.5 * (before[..., LENGTH, None] + after[:, None, :, LENGTH])
    possible = (across < gate) & (along < 0.8 * reach) & (np.abs(turned) < EDGE_GATE_RAD)
    return _mutual(before, after, np.where(possible, across + 0.3 * along, np.inf))


def _edge_residuals(poses: FloatArray, before: FloatArray, after: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance across the mean normal, and difference of the angles, in standard deviations.

    Residual and three derivatives, (n, e, 4) each.
    """
    placed, levers = _placed(after[..., :2], poses)
    turned = _half_turn(after[..., ANGLE] + poses[:, 2, None] - before[..., ANGLE])
    middle = before[..., ANGLE] + 0.5 * turned
    normals = np.stack((np.cos(middle), np.sin(middle)), axis=-1)
    offset = placed - before[..., :2]
    along = normals[..., 0] * offset[..., 1] - normals[..., 1] * offset[..., 0]
    angle_variance = before[..., ANGLE_VARIANCE] + after[..., ANGLE_VARIANCE]
    variance = before[..., VARIANCE] + after[..., VARIANCE] + 0.25 * along**2 * angle_variance
    angle = np.zeros((*turned.shape, 4))
    angle[..., 0], angle[..., 3] = turned, 1.0
    # that the normal turns too is left out of the derivative: it matters by the residual's own size
    return _along(normals, offset, levers) / np.sqrt(variance)[..., None], angle / np.sqrt(angle_variance)[..., None]


def _thing_residuals(poses: FloatArray, before: FloatArray, after: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Along and across the line of sight, in standard deviations: residual and three derivatives, (n, k, 4) each."""
    placed, levers = _placed(after[..., :2], poses)
    centres = before[..., :2]
    sight = centres / np.maximum(np.hypot(centres[..., 0], centres[..., 1]), 1e-9)[..., None]
    side = np.stack((-sight[..., 1], sight[..., 0]), axis=-1)
    offset, deviations = placed - centres, np.sqrt(before[..., THING_VARIANCES] + after[..., THING_VARIANCES])
    return _along(sight, offset, levers) / deviations[..., :1], _along(side, offset, levers) / deviations[..., 1:]


def _along(directions: FloatArray, offset: FloatArray, levers: FloatArray) -> FloatArray:
    """Component of the offset along unit directions, and its derivatives by x, y and the turn: (n, m, 4)."""
    component, by_turn = (directions * offset).sum(axis=-1), (directions * levers).sum(axis=-1)
    return np.stack((component, directions[..., 0], directions[..., 1], by_turn), axis=-1)


def _half_turn(angles: FloatArray) -> FloatArray:
    """Difference of directions without sense, in [-pi/2, pi/2)."""
    return np.mod(angles + 0.5 * np.pi, np.pi) - 0.5 * np.pi
