"""How much may come out of compressed bytes: nobody packs so well as a bomb."""

MOST_INFLATED = 50  # logs pack to a tenth, ranges to a third; zeros to a thousandth
FREE_BYTES = 1 << 22  # that much is free, however small the file
PACKED_BYTES_A_RECORD, FREE_RECORDS = 2, 100_000  # messages differ in their times at least


class Inflation:
    """Counts what a file of `packed_bytes` has been unpacked to."""

    def __init__(self, packed_bytes: int) -> None:
        self.left = max(FREE_BYTES, MOST_INFLATED * packed_bytes)
        self._records_left = FREE_RECORDS + packed_bytes // PACKED_BYTES_A_RECORD

    def take(self, size: int) -> None:
        """Count bytes that came out, or that are announced. Raises ValueError where these are too many."""
        self.left -= size
        if self.left < 0:
            raise ValueError(f"the compressed data unpack to more than {MOST_INFLATED} times their size")

    def take_record(self) -> None:
        """Count one record of what came out. Raises ValueError where these are too many."""
        self._records_left -= 1
        if self._records_left < 0:
            raise ValueError(f"records are packed into less than {PACKED_BYTES_A_RECORD} bytes each")
