"""The state of the joint Gaussian: pose, constants of the odometry, and the landmarks of the window.

Far landmarks leave the state as a regression on neighbours that stay (window.py) and come back by it.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.arithmetic.elementary import squared
from slam.arithmetic.small_matrices import inner
from slam.joint.atlas import AWAY, PARENTS, Atlas
from slam.joint.kernels import append, forget
from slam.joint.measurement import FIRST_PLACE
from slam.joint.window import ORPHAN, least_needed, nearest_places, regress, restore
from slam.observations import Sighting
from slam.settings.joint import MOST_SET, JointSettings

DISTANCE_SCALE_SIGMA = 0.02  # standard deviation of a constant relative error of every distance driven
TURN_SCALE_SIGMA = 0.02  # standard deviation of a constant relative error of every turn
CURVATURE_SIGMA_RADPM = 0.001  # rad/m; standard deviation of a constant pull to one side
FIRST_ROOM = 64
LOOK_EVERY_M = 2.0  # the rover moves this far before landmarks come back again
KEEP_M = 10.0  # beyond what can be in view: what just came back does not leave at once
LEAVING_PER_SCAN = 8
MOST_RETURNING = 256  # at a loop closed through more landmarks than this, a step would take longer than a beat
MOST_IN_STATE = MOST_SET + MOST_RETURNING  # landmarks, however thick they stand: their covariance has 34 MB


class JointState:
    """mean (N,) and covariance (N, N) with room to grow, of which the first `size` entries are in use.

    linearised_at (N,): where each entry was first estimated. rows (L,): the atlas row of each landmark in the state.
    """

    def __init__(self, settings: JointSettings, reach_m: float, cell_m: float) -> None:
        self._limit = settings.landmarks_in_state
        self._reach_m = reach_m
        self._looked_at: tuple[float, float] | None = None
        self.mean = np.zeros(FIRST_PLACE + 2 * FIRST_ROOM)
        self.covariance = np.zeros((len(self.mean), len(self.mean)))
        constants = (DISTANCE_SCALE_SIGMA, TURN_SCALE_SIGMA, CURVATURE_SIGMA_RADPM)
        self.covariance[range(3, FIRST_PLACE), range(3, FIRST_PLACE)] = np.square(constants)
        self.linearised_at = np.zeros_like(self.mean)
        self.atlas = Atlas(cell_m)
        self.count = 0
        self._rows = np.zeros(FIRST_ROOM, dtype=np.int64)

    def copied(self) -> "JointState":
        """A copy that shares nothing."""
        other = copy(self)
        other.mean, other.covariance = self.mean.copy(), self.covariance.copy()
        other.linearised_at, other._rows = self.linearised_at.copy(), self._rows.copy()
        other.atlas = self.atlas.copied()
        return other

    @property
    def size(self) -> int:
        """Entries in use."""
        return FIRST_PLACE + 2 * self.count

    @property
    def rows(self) -> IntArray:
        """(L,) rows of the atlas."""
        return self._rows[: self.count]

    @property
    def points_m(self) -> FloatArray:
        """(L, 2) positions of the landmarks in the state."""
        return self.mean[FIRST_PLACE : self.size].reshape(self.count, 2)

    def rows_at(self, places: IntArray) -> IntArray:
        """Rows of the atlas of the landmarks at places (k,) of the state vector."""
        return self._rows[(places - FIRST_PLACE) // 2]

    def create(self, identity: int, log_odds: float, mount: FloatArray, sighting: Sighting) -> None:
        """A new landmark from its first sighting."""
        self._make_room()
        append(self.mean, self.covariance, self.size, mount, sighting)
        self._enter(self.atlas.add(identity, log_odds, self.size))

    def create_end(self, identity: int, mount: FloatArray, sighting: Sighting) -> int:
        """A point that is no landmark and never goes away; returns its row of the atlas."""
        self.create(identity, math.inf, mount, sighting)
        return int(self._rows[self.count - 1])

    def adopt(self, identity: int, log_odds: float, mean_m: FloatArray) -> int:
        """A landmark of an earlier drive enters the state, its covariance still to be filled in; returns its row."""
        self._make_room()
        self.mean[self.size : self.size + 2] = mean_m
        row = self.atlas.add(identity, log_odds, self.size)
        self._enter(row)
        return row

    def bring_all_back(self) -> list[int]:
        """Everything into the state, however large that becomes; returns the rows that were outside, parents first."""
        returned = self.atlas.with_ancestors(np.flatnonzero(self.atlas.place == AWAY).tolist())
        for row in returned:
            self._bring_one_back(row)
        return returned

    def put_row_away(self, row: int) -> None:
        """One landmark leaves the state."""
        self._put_one_away((int(self.atlas.place[row]) - FIRST_PLACE) // 2)

    @contextmanager
    def frozen_kept(self) -> Iterator[None]:
        """Inside, the state may be updated; landmarks of a saved map have then learnt nothing (Schmidt-Kalman).

        That is their gain set to zero: their means and the block of their covariances stay to the last bit, while what
        they have in common with pose and other landmarks is updated. The update must be additive, not invariant.
        """
        frozen = np.flatnonzero(self.atlas.frozen[self.rows])
        if len(frozen) == 0:
            yield
            return
        places = (FIRST_PLACE + 2 * frozen[:, None] + np.arange(2)).ravel()
        means, within = self.mean[places], np.ix_(places, places)
        among_them = self.covariance[within]
        yield
        self.mean[places] = means
        self.covariance[within] = among_them

    def remove(self, number: int) -> None:
        """Forget the landmark with this number in the state; the last one takes its number."""
        row = int(self._rows[number])
        self._drop(number)
        self.atlas.remove(row)

    def append(self, identity: int, log_odds: float, mean: FloatArray, cross: FloatArray, own: FloatArray) -> None:
        """A landmark known from elsewhere: mean (2,), covariance with the state (2, N) and its own (2, 2)."""
        self._make_room()
        n = self.size
        self.mean[n : n + 2] = mean
        self.covariance[n : n + 2, :n], self.covariance[:n, n : n + 2] = cross, cross.T
        self.covariance[n : n + 2, n : n + 2] = 0.5 * (own + own.T)
        self._enter(self.atlas.add(identity, log_odds, n))

    def take_out(self, rows: IntArray) -> None:
        """Forget landmarks, in the state or outside, where there are any; what hangs on them stands alone."""
        atlas = self.atlas
        rows = rows[atlas.place[rows] >= AWAY]
        hanging = np.isin(atlas.parents, rows).any(axis=1) & (atlas.place == AWAY)
        hanging[rows] = False
        self._stand_alone(np.flatnonzero(hanging).tolist(), self.settled_means())
        for row in rows.tolist():
            if atlas.place[row] == AWAY:
                atlas.take_back(row, AWAY)
            else:
                self._drop((int(atlas.place[row]) - FIRST_PLACE) // 2)
            atlas.remove(row)

    def settled_means(self) -> FloatArray:
        """(R, 2) means of all rows of the atlas as they follow from the state."""
        return self.atlas.settled_means(self.rows, self.points_m)

    def settled_covariances(self) -> FloatArray:
        """(R, 2, 2) of all rows of the atlas; of those outside the state as they were when they left it."""
        covariances: FloatArray = self.atlas.covariances.copy()
        places = FIRST_PLACE + 2 * np.arange(self.count)
        for row in range(2):
            for column in range(2):
                covariances[self.rows, row, column] = self.covariance[places + row, places + column]
        return covariances

    def sort_anew(self) -> None:
        """After the map has moved: find far landmarks by where they are now."""
        self.atlas.sort_anew(self.rows, self.points_m)
        self._looked_at = None

    def put_away(self) -> None:
        """Landmarks beyond the limit leave the state, the least needed ones first, none that may soon be in view."""
        if self.count <= self._limit:
            return
        away = np.square(self.points_m - self.mean[:2]).sum(axis=1) > squared(self._reach_m + KEEP_M + LOOK_EVERY_M)
        excess = min(self.count - self._limit, int(away.sum()) - self._limit // 2, LEAVING_PER_SCAN)
        for _ in range(excess):
            number = least_needed(self.mean, self.size, away)
            self._put_one_away(number)
            away[number] = away[self.count]
            away[self.count] = False

    def _put_one_away(self, number: int) -> None:
        atlas, row, at = self.atlas, int(self._rows[number]), FIRST_PLACE + 2 * number
        others = nearest_places(self.mean, self.size, at, self.count if atlas.frozen[row] else PARENTS)
        if atlas.frozen[row]:  # a landmark of a saved map that hung on others would move with them
            others = others[atlas.frozen[self.rows_at(others)]][:PARENTS]
        parents = len(others)
        atlas.means[row] = self.mean[at : at + 2]
        atlas.covariances[row] = self.covariance[at : at + 2, at : at + 2]
        atlas.parents[row] = ORPHAN
        atlas.parents[row, :parents] = self._rows[(others - FIRST_PLACE) // 2]
        atlas.parent_means[row, : 2 * parents] = np.column_stack((self.mean[others], self.mean[others + 1])).ravel()
        weights = np.zeros((2, 2 * parents))
        regress(self.covariance, at, others, weights, atlas.residuals[row])
        atlas.weights[row, :, : 2 * parents] = weights
        self._drop(number)
        atlas.put_away(row)

    def bring_back(self) -> None:
        """Landmarks that may soon be in view return to the state, with what they hang on as far as there is room."""
        x, y = float(self.mean[0]), float(self.mean[1])
        if self._looked_at is not None and math.dist((x, y), self._looked_at) < LOOK_EVERY_M:
            return
        self._looked_at = (x, y)
        self.bring_back_around(x, y)

    def bring_back_around(self, x: float, y: float) -> None:
        """The same for a rover that may be elsewhere."""
        radius = self._reach_m + LOOK_EVERY_M + 0.5 * KEEP_M

        def gap_square(row: int) -> float:
            """Squared distance, m^2, from where a landmark was when it left the state."""
            gap = self.atlas.means[row] - (x, y)
            return inner(gap, gap)

        near = [row for row in self.atlas.away_near(x, y, radius) if gap_square(row) <= radius * radius]
        returning = self.atlas.with_ancestors(near)
        room = max(0, min(MOST_RETURNING, MOST_IN_STATE - self.count))
        if len(returning) > room:
            nearest = set(sorted(returning, key=gap_square)[:room])
            self._let_stand_alone([row for row in returning if row in nearest], nearest)
            returning = [row for row in returning if row in nearest]
        for row in returning:
            self._bring_one_back(row)

    def _let_stand_alone(self, rows: list[int], returning: set[int]) -> None:
        """Landmarks whose parents do not all return hang on nothing from here on.

        What they had in common with the state is lost with their parents; twice their covariance is the bound that
        holds for any correlation (covariance intersection with equal weights).
        """
        means = self.settled_means()
        for row in rows:
            parents = self.atlas.parents[row]
            if any(self.atlas.place[parent] == AWAY and parent not in returning for parent in parents[parents >= 0]):
                self._stand_alone([row], means)

    def _stand_alone(self, rows: list[int], means: FloatArray) -> None:
        self.atlas.means[rows] = means[rows]
        self.atlas.covariances[rows] *= 2.0
        self.atlas.parents[rows] = ORPHAN

    def _bring_one_back(self, row: int) -> None:
        atlas = self.atlas
        parents = atlas.parents[row][atlas.parents[row] >= 0]
        self._make_room()
        n, count = self.size, len(parents)
        others = atlas.place[parents]
        means = np.column_stack((self.mean[others], self.mean[others + 1])).ravel()
        weights = np.ascontiguousarray(atlas.weights[row, :, : 2 * count])
        residual = atlas.residuals[row] if count else atlas.covariances[row]
        moved = means - atlas.parent_means[row, : 2 * count]
        self.mean[n : n + 2] = atlas.means[row] + (weights * moved).sum(axis=1)
        restore(self.covariance, n, others, weights, residual)
        atlas.take_back(row, n)
        self._enter(row)

    def _enter(self, row: int) -> None:
        """The landmark at the end of the state belongs to this row of the atlas."""
        n = self.size
        self.linearised_at[n : n + 2] = self.mean[n : n + 2]
        self._rows[self.count] = row
        self.count += 1

    def _drop(self, number: int) -> None:
        """Take a landmark out of the state; the last one moves to its place."""
        at, last = FIRST_PLACE + 2 * number, self.count - 1
        forget(self.mean, self.covariance, self.size, at)
        self.linearised_at[at : at + 2] = self.linearised_at[self.size - 2 : self.size]
        self._rows[number] = self._rows[last]
        self.atlas.place[self._rows[number]] = at
        self.count = last

    def _make_room(self) -> None:
        room = len(self._rows)
        if self.count < room:
            return
        self.mean = np.concatenate((self.mean, np.zeros(2 * room)))
        self.linearised_at = np.concatenate((self.linearised_at, np.zeros(2 * room)))
        self._rows = np.concatenate((self._rows, np.zeros(room, dtype=np.int64)))
        covariance = np.zeros((len(self.mean), len(self.mean)))
        covariance[: len(self.covariance), : len(self.covariance)] = self.covariance
        self.covariance = covariance
