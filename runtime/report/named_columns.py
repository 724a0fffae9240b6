"""Figures by name that grow row by row; only numbers stay, eight bytes each."""

import math
from array import array
from collections.abc import Mapping

import numpy as np

from drivers.measurements import FloatArray


class NamedColumns:
    """NaN where a row has no figure of a name."""

    def __init__(self) -> None:
        self._columns: dict[str, array[float]] = {}
        self._rows = 0

    def add(self, row: Mapping[str, float]) -> None:
        """One row more."""
        for name, value in row.items():
            column = self._columns.get(name)
            if column is None:
                column = self._columns[name] = array("d", [math.nan]) * self._rows
            column.append(value)
        self._rows += 1
        for column in self._columns.values():
            if len(column) < self._rows:
                column.append(math.nan)

    def arrays(self, factor: float = 1.0) -> dict[str, FloatArray]:
        """(rows,) each, times the factor."""
        return {name: np.array(column) * factor for name, column in self._columns.items()}
