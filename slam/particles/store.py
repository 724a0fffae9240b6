"""The landmark maps of all particles: allocation, growth, and reading out one particle's map."""

import numpy as np

from drivers.measurements import FloatArray, IntArray
from slam.estimate import LandmarkMap
from slam.particles.pages import FIELDS, FREE_PAGES, LOG_ODDS, NONE, PAGE_LANDMARKS, USED_SLOTS, XX, XY, YY, Pages, X, Y

MOST_CELLS = 1 << 25  # 128 MB: 80 km by 80 km in cells of 15 m
FARTHEST_CELL = 1 << 28  # a grid from there has too many cells, and their number does not overflow


class LandmarkStore:
    """Owns the arrays behind `pages`; they are replaced by larger ones when a step runs out of room."""

    def __init__(self, particles: int, cell_m: float = 15.0, pages: int = 256, slots: int = 64) -> None:
        self.cell_m = cell_m
        self.pages = Pages(
            np.zeros((pages, FIELDS, PAGE_LANDMARKS)),
            np.zeros((pages, PAGE_LANDMARKS), dtype=np.int64),
            np.zeros(pages, dtype=np.int32),
            np.zeros(pages, dtype=np.int32),
            np.full((particles, slots), NONE, dtype=np.int32),
            np.full(slots, NONE, dtype=np.int32),
            np.full((8, 8), NONE, dtype=np.int32),
            np.array((-4, -4), dtype=np.int64),
            np.arange(pages, dtype=np.int32)[::-1].copy(),
            np.array((pages, 0), dtype=np.int64),
        )

    def cover(self, poses: FloatArray, radius_m: float) -> None:
        """Enlarge the grid so that it holds every point within radius_m of poses (M, 3), up to MOST_CELLS: what lies
        farther off is kept in the cells at its edge.
        """
        reach = np.abs(poses[:, :2]).max() + radius_m + np.abs(self.pages.origin * self.cell_m).max()
        if not reach < FARTHEST_CELL * self.cell_m:  # of NaN too
            return
        low = np.floor((poses[:, :2].min(axis=0) - radius_m) / self.cell_m).astype(np.int64)
        high = np.floor((poses[:, :2].max(axis=0) + radius_m) / self.cell_m).astype(np.int64)
        old = self.pages
        old_high = old.origin + np.array(old.grid.shape) - 1
        if (low >= old.origin).all() and (high <= old_high).all():
            return
        # a margin on the side that grows, so that a straight drive does not enlarge it in every step
        new_low = np.where(low < old.origin, low - 8, old.origin)
        new_high = np.where(high > old_high, high + 8, old_high)
        if np.prod(new_high - new_low + 1) > MOST_CELLS:
            return
        grid = np.full(new_high - new_low + 1, NONE, dtype=np.int32)
        at = old.origin - new_low
        grid[at[0] : at[0] + old.grid.shape[0], at[1] : at[1] + old.grid.shape[1]] = old.grid
        self.pages = old._replace(grid=grid, origin=new_low)

    def grow(self, new_landmarks: int, shared_pages: int) -> None:
        """Room for as many new landmarks and for copying as many shared pages."""
        old = self.pages
        free, used = int(old.tally[FREE_PAGES]), int(old.tally[USED_SLOTS])
        slots = old.overflow.size
        if slots - used < new_landmarks:
            more = max(new_landmarks, slots // 2)
            table = np.full((old.table.shape[0], slots + more), NONE, dtype=np.int32)
            table[:, :slots] = old.table
            self.pages = self.pages._replace(
                table=table, overflow=np.append(old.overflow, np.full(more, NONE, dtype=np.int32))
            )
        count = old.filled.size
        if free < new_landmarks + shared_pages:
            more = max(new_landmarks + shared_pages, count // 2)
            tally = old.tally.copy()
            tally[FREE_PAGES] = free + more
            stack = np.empty(count + more, dtype=np.int32)
            stack[:more] = np.arange(count + more - 1, count - 1, -1)
            stack[more : more + free] = old.free[:free]
            self.pages = self.pages._replace(
                numbers=np.concatenate((old.numbers, np.zeros((more, FIELDS, PAGE_LANDMARKS)))),
                identity=np.concatenate((old.identity, np.zeros((more, PAGE_LANDMARKS), dtype=np.int64))),
                filled=np.append(old.filled, np.zeros(more, dtype=np.int32)),
                references=np.append(old.references, np.zeros(more, dtype=np.int32)),
                free=stack,
                tally=tally,
            )

    def map_of(self, particle: int) -> LandmarkMap:
        """All landmarks of one particle, ordered by identity."""
        identities, numbers = self.rows_of(particle)
        order = np.argsort(identities, kind="stable")
        numbers = numbers[order]
        covariances = numbers[:, (XX, XY, XY, YY)].reshape(-1, 2, 2)
        return LandmarkMap(identities[order], numbers[:, (X, Y)], covariances, numbers[:, LOG_ODDS])

    def rows_of(self, particle: int) -> tuple[IntArray, FloatArray]:
        """Identities (L,) and numbers (L, 6) of one particle in the order of storage."""
        row = self.pages.table[particle, : self.pages.tally[USED_SLOTS]]
        own = row[row != NONE]
        filled = np.arange(PAGE_LANDMARKS) < self.pages.filled[own][:, np.newaxis]
        return self.pages.identity[own][filled], self.pages.numbers[own].transpose(0, 2, 1)[filled]

    def count_of(self, particle: int) -> int:
        """Number of landmarks of one particle."""
        row = self.pages.table[particle, : self.pages.tally[USED_SLOTS]]
        return int(self.pages.filled[row[row != NONE]].sum())

    def allocated_bytes(self) -> int:
        """Memory of all arrays."""
        return int(sum(array.nbytes for array in self.pages))

    def used_bytes(self) -> int:
        """Memory of the pages in use and of the tables."""
        pages = self.pages.filled.size - int(self.pages.tally[FREE_PAGES])
        page_bytes = self.pages.numbers[0].nbytes + self.pages.identity[0].nbytes + 12
        return int(pages * page_bytes + self.pages.table.nbytes + self.pages.overflow.nbytes + self.pages.grid.nbytes)
