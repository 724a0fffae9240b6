"""Figures by name that grow row by row; only numbers stay, eight bytes each."""

import math
from array import array
from collections.abc import Callable, Mapping

import numpy as np

from drivers.measurements import FloatArray


class NamedColumns:
    """NaN where a row has no figure of a name."""

    def __init__(self) -> None:
        self._columns: dict[str, array[float]] = {}
        self._rows = 0
        self._complete: tuple[str, ...] = ()
        self._appends: list[Callable[[float], None]] = []

    def add(self, row: Mapping[str, float]) -> None:
        """One row more."""
        names = tuple(row)
        if names == self._complete:  # as the row before, and no column is left out: nearly every one
            for append, value in zip(self._appends, row.values(), strict=True):
                append(value)
            self._rows += 1
            return
        for name, value in row.items():
            column = self._columns.get(name)
            if column is None:
                column = self._columns[name] = array("d", [math.nan]) * self._rows
            column.append(value)
        self._rows += 1
        for column in self._columns.values():
            if len(column) < self._rows:
                column.append(math.nan)
        if len(names) == len(self._columns):
            self._complete, self._appends = names, [self._columns[name].append for name in names]
        else:
            self._complete, self._appends = (), []

    def arrays(self, factor: float = 1.0) -> dict[str, FloatArray]:
        """(rows,) each, times the factor."""
        return {name: np.asarray(column) * factor for name, column in self._columns.items()}
