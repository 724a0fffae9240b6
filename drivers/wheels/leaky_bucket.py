"""A fault that needs several faults in a row, as opendbc counts them."""


class LeakyBucket:
    """Full after `limit` bad frames more than good ones; stays so until it has run dry."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._level = 0
        self.full = False

    def add(self) -> None:
        """One bad frame."""
        self._level = min(self._level + 1, self._limit)
        if self._level == self._limit:
            self.full = True

    def drain(self) -> None:
        """One good frame."""
        self._level = max(self._level - 1, 0)
        if self._level == 0:
            self.full = False
