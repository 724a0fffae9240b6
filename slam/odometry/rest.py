"""Whether the rover has just come to rest."""

FREE_NS = 1_000_000_000


class Rest:
    """In the first second at rest everything may create a landmark; afterwards earlier scans vote, or who walks past
    a rover that stands would become part of its map.
    """

    def __init__(self) -> None:
        self._since_ns: int | None = None

    @property
    def lasts(self) -> bool:
        """Whether the wheels stood at the last stamp."""
        return self._since_ns is not None

    def has_just_begun(self, stamp_ns: int, at_rest: bool) -> bool:
        """True in the first second at rest; to be asked at every scan."""
        if not at_rest:
            self._since_ns = None
            return False
        if self._since_ns is None:
            self._since_ns = stamp_ns
        return stamp_ns - self._since_ns < FREE_NS
