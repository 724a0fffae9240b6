"""Lines of a text log, also compressed by gzip: as many as can be read, and in words what was wrong at the end."""

import zlib
from collections.abc import Iterator
from pathlib import Path

from runtime.bounded_read import open_regular
from runtime.importers.parsing.inflation import Inflation

GZIP = b"\x1f\x8b"
BLOCK_BYTES = 1 << 16
PACKED_BYTES_A_LINE = 2  # two lines of a log differ in their times: 3 and more were seen
FREE_LINES = 100_000  # however well they are packed
LINE_BYTES = 1 << 20  # a scan of 32768 beams has 300 kB; what is longer is no line of a log
MOST_LINES = 3_000_000  # of one log; of such that are none, it takes ten seconds
MOST_KEPT_BYTES = 150_000_000  # of what is kept of them: 200 000 odometry samples, 50 000 scans or a million frames


class TextLines:
    """Iterates over (number, line, is_whole) of a file. Every byte is a character (Latin-1), so comments in any
    encoding pass. is_whole: False for a last line without its line feed. damage: known at the end, "" where all of the
    file could be read; it stops as well where it has too many lines, or where `keep` was told of too much. Raises
    OSError.
    """

    def __init__(self, source: Path) -> None:
        self.source = source
        self.damage = ""
        self._room = MOST_KEPT_BYTES

    def keep(self, size: int) -> None:
        """Count the memory that the reader takes for the line it has been given."""
        self._room -= size

    def __iter__(self) -> Iterator[tuple[int, str, bool]]:
        number, pending = 0, b""
        for block in self._blocks():
            *lines, pending = (pending + block).split(b"\n")
            for line in lines:
                if number == MOST_LINES or self._room < 0:
                    self.damage = f"what follows line {number} is more than fits into one run; split the log there"
                    return
                number += 1
                yield number, line.decode("latin-1"), True
            if len(pending) > LINE_BYTES:
                self.damage = f"line {number + 1} does not end"
                return
        if pending:
            yield number + 1, pending.decode("latin-1"), False

    def _blocks(self) -> Iterator[bytes]:
        with open_regular(self.source) as stream:
            head = stream.read(len(GZIP))
            stream.seek(0)
            blocks = iter(lambda: stream.read(BLOCK_BYTES), b"")
            yield from self._inflated(blocks) if head == GZIP else blocks

    def _inflated(self, blocks: Iterator[bytes]) -> Iterator[bytes]:
        """What comes out of one gzip member or several behind each other, up to where they are damaged."""
        packed_bytes = self.source.stat().st_size
        inflater, fresh, inflation = zlib.decompressobj(31), True, Inflation(packed_bytes)
        lines_left = FREE_LINES + packed_bytes // PACKED_BYTES_A_LINE
        for block in blocks:
            rest = block
            while rest.strip(b"\0") if fresh else rest:  # members may be padded by zeros
                try:
                    inflated = inflater.decompress(rest, BLOCK_BYTES)
                    inflation.take(len(inflated))
                except zlib.error as error:
                    self.damage = f"the compressed data are damaged ({error})"
                    return
                except ValueError as error:
                    self.damage = str(error)
                    return
                lines_left -= inflated.count(b"\n")
                if lines_left < 0:
                    self.damage = (
                        f"lines are packed into less than {PACKED_BYTES_A_LINE} bytes each, as those of no log"
                    )
                    return
                yield inflated
                rest, fresh = inflater.unused_data if inflater.eof else inflater.unconsumed_tail, inflater.eof
                if inflater.eof:
                    inflater = zlib.decompressobj(31)
        if not fresh:
            self.damage = "the compressed file ends early"
