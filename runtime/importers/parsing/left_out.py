"""What an importer could not use: counted by reason, with the place where it was seen first."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from runtime.printable import printable

MOST_REASONS = 100
LONGEST = 200  # characters of a reason
MUCH = 0.01  # share from which on what is left out deserves a warning


@dataclass(slots=True)
class LeftOut:
    """Rows by what they are ("scans", "odometry samples", ...) and why they could not be used.

    used: rows of a kind that a reader knows to be used. notes and warnings: sentences about the recording as a whole.
    Shared by all copies of an Archive.
    """

    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    first_places: dict[tuple[str, str], str] = field(default_factory=dict)
    used: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def add(self, what: str, reason: str, place: str = "", count: int = 1) -> None:
        """Count rows that are not used. place: file and line, or the array and its row."""
        reason, place = printable(reason, LONGEST), printable(place, LONGEST)
        if len(self.counts) >= MOST_REASONS and (what, reason) not in self.counts:
            reason = "further reasons"  # a recording of others may have one of its own for each line
        if count > 0:
            self.counts[what, reason] += count
            self.first_places.setdefault((what, reason), place)

    def join(self, other: "LeftOut") -> None:
        """Take over what the reader of another part of the recording says."""
        self.counts.update(other.counts)
        self.first_places |= other.first_places
        self.used.update(other.used)
        self.notes += other.notes
        self.warnings += other.warnings

    def first(self) -> str:
        """The first thing that could not be used, as one clause; "" where there was none."""
        for (_, reason), place in self.first_places.items():
            return f"{place}: {reason}" if place else reason
        return ""

    def total(self, what: str) -> int:
        """How many rows of this kind are left out."""
        return sum(count for (kind, _), count in self.counts.items() if kind == what)

    def sentences(self, used: Mapping[str, int]) -> tuple[list[str], list[str]]:
        """(notes, warnings): one sentence a reason, as a warning where it is more than 1 % of its kind.

        used: how many rows of each kind are used, where the reader does not know it.
        """
        notes, warnings = list(self.notes), list(self.warnings)
        for (what, reason), count in self.counts.items():
            of = used.get(what, self.used[what]) + self.total(what)
            place = self.first_places[what, reason]
            text = f"{count} of {of} {what} left out: {reason}" + (f" (first: {place})" if place else "")
            (warnings if count > MUCH * of else notes).append(text)
        return notes, warnings
