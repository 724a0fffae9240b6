"""One particle's landmarks out of the shared pages for a step, and those that changed back into pages of its own."""

import math

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import FloatArray, IntArray
from slam.compiled import kernel, leaf
from slam.particles.pages import FIELDS, NONE, Pages, X, Y, writable

ShortArray = NDArray[np.int32]


@kernel
def gather(
    pages: Pages, particle: int, slots: ShortArray, slot_count: int, x: float, y: float, radius_m: float
) -> tuple[FloatArray, IntArray, ShortArray, int]:
    """Copies of this particle's landmarks in the slots that lie within a radius of (x, y); below zero: all of them.

    Returns numbers (C, 6), identities (C,), (slot, place) (C, 2), and how many of the pages are shared with other
    particles.
    """
    total, shared = 0, 0
    for index in range(slot_count):
        page = pages.table[particle, slots[index]]
        if page != NONE:
            total += pages.filled[page]
            shared += 1 if pages.references[page] > 1 else 0
    numbers = np.empty((total, FIELDS))
    identities = np.empty(total, dtype=np.int64)
    places = np.empty((total, 2), dtype=np.int32)
    filled = 0
    square = radius_m * radius_m if radius_m >= 0.0 else math.inf
    for index in range(slot_count):
        page = pages.table[particle, slots[index]]
        if page != NONE:
            for place in range(pages.filled[page]):
                dx, dy = pages.numbers[page, X, place] - x, pages.numbers[page, Y, place] - y
                if dx * dx + dy * dy > square:
                    continue
                for field in range(FIELDS):
                    numbers[filled, field] = pages.numbers[page, field, place]
                identities[filled] = pages.identity[page, place]
                places[filled, 0], places[filled, 1] = slots[index], place
                filled += 1
    return numbers[:filled], identities[:filled], places[:filled], shared


@leaf
def write_back(
    pages: Pages, particle: int, candidates: FloatArray, places: ShortArray, changed: NDArray[np.bool_]
) -> None:
    """Store the landmarks that changed into this particle's own pages."""
    for index in range(candidates.shape[0]):
        if changed[index]:
            page = writable(pages, particle, places[index, 0])
            for field in range(FIELDS):
                pages.numbers[page, field, places[index, 1]] = candidates[index, field]
