"""Motion of the laser between two scans, from the shapes that both show; what moved by itself is weighted away."""

from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray, IntArray
from runtime.calibrate.scans.shapes import Shapes
from slam.pose import rotated

GATES_M = (0.6, 0.3, 0.2)  # how far apart shapes of one thing may be: wide at first, the guess comes from the wheels
EDGE_GATE_RAD = 0.2
ROUNDS = 4
ROBUST = 2.4  # deviations at which a residual has a quarter of its weight (Geman and McClure): walkers fall out
UNKNOWN_M, UNKNOWN_RAD = 1.0, 1.0  # a direction that no shape fixes keeps this deviation


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """before_from_after of the laser: mean (3,), covariance (3, 3); pairs used; outlier_share: beyond 3 deviations."""

    mean: FloatArray
    covariance: FloatArray
    pairs: int
    outlier_share: float


def match(before: Shapes, after: Shapes, guess: FloatArray) -> Match:
    """Align; `guess` (3,) is before_from_after as the wheels say. With nothing in common the covariance stays wide."""
    pose = guess.copy()
    prior = np.array((UNKNOWN_M**-2, UNKNOWN_M**-2, UNKNOWN_RAD**-2))
    scale, pairs, outlier_share = 1.0, 0, 0.0
    information = np.diag(prior)
    for gate in GATES_M:
        edges, things = _paired_edges(before, after, pose, gate), _paired_things(before, after, pose, gate)
        pairs = len(edges[0]) + len(things[0])
        for _ in range(ROUNDS):
            residuals, jacobian = _residuals(before, after, pose, edges, things)
            if len(residuals) == 0:
                break
            scale = max(1.0, 1.4826 * float(np.median(np.abs(residuals))))
            weights = 1.0 / (1.0 + (residuals / (ROBUST * scale)) ** 2) ** 2
            information = (jacobian * weights[:, None]).T @ jacobian / scale**2 + np.diag(prior)
            gradient = (jacobian * weights[:, None]).T @ residuals / scale**2 + prior * (pose - guess)
            step = np.linalg.solve(information, gradient)
            pose = pose - step
            outlier_share = float(np.mean(np.abs(residuals) > 3.0 * scale))
            if np.abs(step).max() < 1e-6:
                break
    return Match(pose, np.linalg.inv(information), pairs, outlier_share)


def _placed(points: FloatArray, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points in the frame before, and the lever by which a turn moves them."""
    turned = rotated(points, pose[2])
    return turned + pose[:2], np.stack((-turned[:, 1], turned[:, 0]), axis=-1)


def _mutual(cost: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs of rows and columns that are each other's cheapest; infinite cost pairs with nothing."""
    if cost.size == 0:
        empty = np.zeros(0, dtype=np.int64)
        return empty, empty
    best = np.argmin(cost, axis=1)
    rows = np.arange(len(cost))
    kept = (np.argmin(cost, axis=0)[best] == rows) & np.isfinite(cost[rows, best])
    return rows[kept], best[kept].astype(np.int64)


def _paired_things(before: Shapes, after: Shapes, pose: FloatArray, gate: float) -> tuple[IntArray, IntArray]:
    placed, _ = _placed(after.thing_centres_m, pose)
    difference = before.thing_centres_m[:, None] - placed[None]
    distance = np.hypot(difference[..., 0], difference[..., 1])
    return _mutual(np.where(distance < gate, distance, np.inf))


def _paired_edges(before: Shapes, after: Shapes, pose: FloatArray, gate: float) -> tuple[IntArray, IntArray]:
    placed, _ = _placed(after.edge_centres_m, pose)
    angles = after.edge_angles_rad + pose[2]
    turned = _half_turn(before.edge_angles_rad[:, None] - angles[None])
    middle = angles[None] + 0.5 * turned
    offset = before.edge_centres_m[:, None] - placed[None]
    across = np.abs(np.cos(middle) * offset[..., 0] + np.sin(middle) * offset[..., 1])
    along = np.abs(np.cos(middle) * offset[..., 1] - np.sin(middle) * offset[..., 0])
    reach = 0.5 * (before.edge_lengths_m[:, None] + after.edge_lengths_m[None])
    possible = (across < gate) & (along < 0.8 * reach) & (np.abs(turned) < EDGE_GATE_RAD)
    return _mutual(np.where(possible, across + 0.3 * along, np.inf))


def _residuals(
    before: Shapes,
    after: Shapes,
    pose: FloatArray,
    edges: tuple[IntArray, IntArray],
    things: tuple[IntArray, IntArray],
) -> tuple[FloatArray, FloatArray]:
    """Residuals (m,) in standard deviations and their Jacobian (m, 3)."""
    parts = [*_edge_residuals(before, after, pose, *edges), *_thing_residuals(before, after, pose, *things)]
    return np.concatenate([part[:, 0] for part in parts]), np.concatenate([part[:, 1:] for part in parts])


def _edge_residuals(
    before: Shapes, after: Shapes, pose: FloatArray, left: IntArray, right: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Distance across the mean normal, and difference of the angles: residual and three derivatives, (m, 4) each."""
    placed, levers = _placed(after.edge_centres_m[right], pose)
    turned = _half_turn(after.edge_angles_rad[right] + pose[2] - before.edge_angles_rad[left])
    middle = before.edge_angles_rad[left] + 0.5 * turned
    normals = np.stack((np.cos(middle), np.sin(middle)), axis=-1)
    offset = placed - before.edge_centres_m[left]
    along = normals[:, 0] * offset[:, 1] - normals[:, 1] * offset[:, 0]
    angle_variance = before.edge_angle_variances[left] + after.edge_angle_variances[right]
    variance = before.edge_variances_m2[left] + after.edge_variances_m2[right] + 0.25 * along**2 * angle_variance
    weight = 1.0 / np.sqrt(variance)
    angle = np.zeros((len(left), 4))
    angle[:, 0], angle[:, 3] = turned, 1.0
    # that the normal turns too is left out of the derivative: it matters by the residual's own size
    return _along(normals, offset, levers) * weight[:, None], angle / np.sqrt(angle_variance)[:, None]


def _thing_residuals(
    before: Shapes, after: Shapes, pose: FloatArray, left: IntArray, right: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Along and across the line of sight: residual and three derivatives, (m, 4) each."""
    placed, levers = _placed(after.thing_centres_m[right], pose)
    centres = before.thing_centres_m[left]
    sight = centres / np.maximum(np.hypot(centres[:, 0], centres[:, 1]), 1e-9)[:, None]
    side = np.stack((-sight[:, 1], sight[:, 0]), axis=-1)
    offset = placed - centres
    deviations = np.sqrt(before.thing_variances_m2[left] + after.thing_variances_m2[right])
    return _along(sight, offset, levers) / deviations[:, :1], _along(side, offset, levers) / deviations[:, 1:]


def _along(directions: FloatArray, offset: FloatArray, levers: FloatArray) -> FloatArray:
    """Component of the offset along unit directions, and its derivatives by x, y and the turn: (m, 4)."""
    component, by_turn = (directions * offset).sum(axis=1), (directions * levers).sum(axis=1)
    return np.stack((component, directions[:, 0], directions[:, 1], by_turn), axis=-1)


def _half_turn(angles: FloatArray) -> FloatArray:
    """Difference of directions without sense, in [-pi/2, pi/2)."""
    return np.mod(angles + 0.5 * np.pi, np.pi) - 0.5 * np.pi
