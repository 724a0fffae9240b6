"""The last totals of one wheel, to be read at any instant between them."""

from collections import deque

LENGTH = 64  # 1.3 s at 50 Hz: more than any skew between two wheels that still counts as alive


class WheelHistory:
    """Points (stamp_ns, total, epoch), oldest first; epochs part points whose totals must not be joined."""

    def __init__(self, longest_gap_ns: int) -> None:
        self._points: deque[tuple[int, float, int]] = deque(maxlen=LENGTH)
        self._longest_gap_ns = longest_gap_ns

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the last point."""
        return self._points[-1][0] if self._points else None

    def add(self, stamp_ns: int, total: float, epoch: int) -> None:
        """Append; a point that is not newer takes the place of the last one, as frames of one bunch share a stamp."""
        points = self._points
        if points and stamp_ns <= points[-1][0]:
            stamp_ns = points.pop()[0]
        points.append((stamp_ns, total, epoch))

    def at(self, stamp_ns: int) -> tuple[float, int] | None:
        """Total and epoch at an instant, linear between two points.

        None outside the history, between epochs, and within a gap too long to be bridged by a straight line.
        """
        after: tuple[int, float, int] | None = None
        for point in reversed(self._points):
            if point[0] == stamp_ns:
                return point[1], point[2]
            if point[0] < stamp_ns:
                return self._between(point, after, stamp_ns) if after is not None else None
            after = point
        return None

    def _between(
        self, before: tuple[int, float, int], after: tuple[int, float, int], stamp_ns: int
    ) -> tuple[float, int] | None:
        span_ns = after[0] - before[0]
        if before[2] != after[2] or span_ns > self._longest_gap_ns:
            return None
        part = (stamp_ns - before[0]) / span_ns
        return before[1] + part * (after[1] - before[1]), before[2]
