"""Scans and wheel samples of a recording become ticks, as a loop at that time would have built them."""

from collections.abc import Iterable, Iterator

from drivers.measurements import ScanLike, WheelSample
from runtime.tick import Tick

LONG_NS = 150_000_000  # scans farther apart than this get ticks between them, so that poses exist at a useful rate
MARGIN_NS = 50_000_000  # a tick nearer than this to the next scan would say nothing new


def ticks(seen: Iterable[ScanLike], wheels: list[WheelSample], spacing_ns: int) -> Iterator[Tick]:
    """One tick for each scan, at its stamp, with the wheel samples since the tick before.

    Between scans that are far apart there are ticks without a scan at wheel samples at least spacing_ns apart: at the
    sample and not on a grid of their own, so that no pose is carried on beyond what was measured.
    """
    seq, first, now_ns = 0, 0, None
    for scan in seen:
        for stamp_ns, end in _between(wheels, first, now_ns, scan.stamp_ns, spacing_ns):
            yield Tick(seq, stamp_ns, None, tuple(wheels[first:end]))
            seq, first = seq + 1, end
        end = _end(wheels, first, scan.stamp_ns)
        yield Tick(seq, scan.stamp_ns, scan, tuple(wheels[first:end]))
        seq, first, now_ns = seq + 1, end, scan.stamp_ns
    for stamp_ns, end in _between(wheels, first, now_ns, None, spacing_ns):
        yield Tick(seq, stamp_ns, None, tuple(wheels[first:end]))
        seq, first = seq + 1, end
    if first < len(wheels):
        yield Tick(seq, wheels[-1].stamp_ns, None, tuple(wheels[first:]))


def _between(
    wheels: list[WheelSample], first: int, from_ns: int | None, to_ns: int | None, spacing_ns: int
) -> Iterator[tuple[int, int]]:
    """(stamp, end of its samples) of the ticks between two scans; None: before the first or after the last scan."""
    if from_ns is not None and to_ns is not None and to_ns - from_ns <= LONG_NS:
        return
    last_ns = from_ns
    for k in range(first, len(wheels)):
        stamp_ns = wheels[k].stamp_ns
        if to_ns is not None and stamp_ns > to_ns - MARGIN_NS:
            return
        if last_ns is None or stamp_ns - last_ns >= spacing_ns:
            last_ns = stamp_ns
            yield stamp_ns, k + 1


def _end(wheels: list[WheelSample], first: int, stamp_ns: int) -> int:
    """Index after the last sample at or before a stamp."""
    while first < len(wheels) and wheels[first].stamp_ns <= stamp_ns:
        first += 1
    return first
