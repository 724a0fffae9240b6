"""Landmarks of all particles in copy-on-write pages, one page per particle and cell of the plane.

A page holds up to PAGE_LANDMARKS landmarks. A table [particle, slot] holds page numbers (-1: none); a slot stands for
a cell, or for more room in a cell that is full (`overflow` links to it). Particles share pages until one of them
writes. Every function that writes goes through `writable`, so that a particle never sees another's writes.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray, IntArray
from slam.compiled import leaf

ShortArray = NDArray[np.int32]

PAGE_LANDMARKS = 8
X, Y, XX, XY, YY, LOG_ODDS = 0, 1, 2, 3, 4, 5
FIELDS = 6
FREE_PAGES, USED_SLOTS = 0, 1
NONE = -1


class Pages(NamedTuple):
    """All arrays of the store.

    numbers (P, 6, 8): mean x, y m, covariance xx, xy, yy m^2, existence log-odds; identity (P, 8); filled, references
    (P,); table (M, S) page of a slot; overflow (S,) next slot of the same cell; grid (I, J) first slot of a cell;
    origin (2,) cell coordinates of grid[0, 0]; free (P,) stack of unused pages; tally (2,) free pages and used slots.
    """

    numbers: FloatArray
    identity: IntArray
    filled: ShortArray
    references: ShortArray
    table: ShortArray
    overflow: ShortArray
    grid: ShortArray
    origin: IntArray
    free: ShortArray
    tally: IntArray


@leaf
def cell_index(pages: Pages, cell_m: float, x: float, y: float) -> tuple[int, int]:
    """Row and column of the grid for a point; outside of the grid its edge cell, so that nothing is ever lost."""
    row = math.floor(x / cell_m) - pages.origin[0]
    column = math.floor(y / cell_m) - pages.origin[1]
    row = min(max(row, 0), pages.grid.shape[0] - 1)
    column = min(max(column, 0), pages.grid.shape[1] - 1)
    return row, column


@leaf
def release(pages: Pages, page: int) -> None:
    """One reference less; a page without any is free."""
    pages.references[page] -= 1
    if pages.references[page] == 0:
        pages.free[pages.tally[FREE_PAGES]] = page
        pages.tally[FREE_PAGES] += 1


@leaf
def take_free(pages: Pages) -> int:
    """An unused page with one reference and no landmarks; the caller has made sure that there is one."""
    pages.tally[FREE_PAGES] -= 1
    page: int = pages.free[pages.tally[FREE_PAGES]]
    pages.references[page] = 1
    pages.filled[page] = 0
    return page


@leaf
def writable(pages: Pages, particle: int, slot: int) -> int:
    """The page of this particle and slot, its own from now on: copied first where it was shared, made where absent."""
    page: int = pages.table[particle, slot]
    if page == NONE:
        page = take_free(pages)
        pages.table[particle, slot] = page
    elif pages.references[page] > 1:
        own = take_free(pages)
        for place in range(PAGE_LANDMARKS):
            for field in range(FIELDS):
                pages.numbers[own, field, place] = pages.numbers[page, field, place]
            pages.identity[own, place] = pages.identity[page, place]
        pages.filled[own] = pages.filled[page]
        pages.references[page] -= 1
        pages.table[particle, slot] = own
        page = own
    return page


@leaf
def append(pages: Pages, particle: int, cell_m: float, landmark: FloatArray, identity: int) -> None:
    """Add landmark (6,) to the cell that its mean lies in; the caller has made sure of a free page and a free slot."""
    row, column = cell_index(pages, cell_m, landmark[X], landmark[Y])
    slot, last = pages.grid[row, column], NONE
    while slot != NONE:
        page = pages.table[particle, slot]
        if page == NONE or pages.filled[page] < PAGE_LANDMARKS:
            break
        last, slot = slot, pages.overflow[slot]
    if slot == NONE:
        slot = pages.tally[USED_SLOTS]
        pages.tally[USED_SLOTS] += 1
        if last == NONE:
            pages.grid[row, column] = slot
        else:
            pages.overflow[last] = slot
    page = writable(pages, particle, slot)
    place = pages.filled[page]
    for field in range(FIELDS):
        pages.numbers[page, field, place] = landmark[field]
    pages.identity[page, place] = identity
    pages.filled[page] = place + 1


@leaf
def remove_below(pages: Pages, particle: int, slot: int, log_odds: float) -> int:
    """Remove this particle's landmarks of one slot whose log-odds are below the bound; returns how many."""
    page = pages.table[particle, slot]
    doomed = 0
    for place in range(pages.filled[page]):
        if pages.numbers[page, LOG_ODDS, place] < log_odds:
            doomed += 1
    if doomed == 0:
        return 0
    page = writable(pages, particle, slot)
    kept = 0
    for place in range(pages.filled[page]):
        if pages.numbers[page, LOG_ODDS, place] >= log_odds:
            for field in range(FIELDS):
                pages.numbers[page, field, kept] = pages.numbers[page, field, place]
            pages.identity[page, kept] = pages.identity[page, place]
            kept += 1
    pages.filled[page] = kept
    if kept == 0:
        release(pages, page)
        pages.table[particle, slot] = NONE
    return doomed


@leaf
def adopt_row(pages: Pages, particle: int, parent: int) -> None:
    """The whole map of `parent` becomes that of `particle`, without copying a landmark."""
    for slot in range(pages.tally[USED_SLOTS]):
        old, new = pages.table[particle, slot], pages.table[parent, slot]
        if old == new:
            continue
        if old != NONE:
            release(pages, old)
        if new != NONE:
            pages.references[new] += 1
        pages.table[particle, slot] = new


@leaf
def slots_near(pages: Pages, cell_m: float, x: float, y: float, radius_m: float, slots: ShortArray) -> int:
    """Write the slots of all cells that a circle's bounding square touches into `slots`; returns how many.

    A radius below zero asks for every slot. `slots` must be as long as the number of used slots.
    """
    found = 0
    if radius_m < 0.0:
        for slot in range(pages.tally[USED_SLOTS]):
            slots[found] = slot
            found += 1
        return found
    first_row, first_column = cell_index(pages, cell_m, x - radius_m, y - radius_m)
    last_row, last_column = cell_index(pages, cell_m, x + radius_m, y + radius_m)
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            slot = pages.grid[row, column]
            while slot != NONE:
                slots[found] = slot
                found += 1
                slot = pages.overflow[slot]
    return found
