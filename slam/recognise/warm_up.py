"""A small map and a piece of it, so that every kernel of recognition is compiled before the first is needed."""

import numpy as np

from slam.recognise.attempt import LocalPoints, recognise
from slam.recognise.map_index import index_of
from slam.recognise.scale import Scale

COLUMNS, ROWS = 7, 5
APART_M = 6.0


def warm_up_recognition() -> None:
    """Make an index, change it, and recognise a part of it."""
    identities = np.arange(COLUMNS * ROWS)
    column, row = identities % COLUMNS, identities // COLUMNS
    means = APART_M * np.column_stack((column + 0.1 * row * row, row + 0.07 * column * column)).astype(np.float64)
    index = index_of(Scale(0.1), identities, means)
    index.follow(identities[1:], means[1:])
    seen = means[: 2 * COLUMNS]
    recognise(index, LocalPoints(identities[: len(seen)], seen, 1e-4 * np.eye(2 * len(seen)), np.ones(len(seen))))
