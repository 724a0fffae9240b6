"""The manifest of a run: one line for each segment that was closed, marked, removed or lost, in a chain of hashes.

Each line is a JSON object; its `chain` is the SHA-256 over the chain of the line before and the line's other facts.
A line can therefore be neither changed nor taken out of the middle without it being seen. The file is replaced as a
whole: it is small (one line a minute), and so it is never torn.
"""

import hashlib
import json
from bisect import bisect_right
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from runtime.atomic_write import atomic_write
from runtime.bounded_read import read_bounded

Facts = dict[str, Any]

LARGEST_BYTES = 16 << 20  # a month of segments of a minute
FAR = 1 << 62  # largest of stamps, sizes and counts
LONGEST_LINE = 16 << 10  # a mark of 1000 characters takes 12 kB where each is written as two escapes
KINDS: dict[str, dict[str, type]] = {
    "run": {"created_utc": str},
    "segment": {
        "name": str,
        "number": int,
        "bytes": int,
        "sha256": str,
        "first_ns": int,
        "last_ns": int,
        "ticks": int,
    },
    "mark": {"from_ns": int, "to_ns": int, "reason": str},
    "removed": {"name": str, "reason": str},
    "lost": {"name": str, "ticks": int, "reason": str},
}
"""Kinds of lines, and what each has to say."""


class Told(NamedTuple):
    """What a manifest says of segments, by name, looked up once for whoever asks for each of many thousands."""

    segments: dict[str, Facts]
    removed: dict[str, str]
    lost: set[str]
    ticks: dict[str, int]


class Manifest:
    """Lines in memory and, after `save`, on disk. `damage` says from where the file could not be believed.

    foreign: its hashes are right, but no recorder of ours says such a thing: nothing beside it can be believed either.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lines: list[Facts] = []
        self.damage = ""
        self.foreign = False
        self.saved = True

    @classmethod
    def load(cls, path: Path) -> "Manifest":
        """Every line up to the first that is wrong; empty when there is no file (runs of older releases)."""
        manifest = cls(path)
        try:
            content = read_bounded(path, LARGEST_BYTES)
        except FileNotFoundError:
            return manifest
        except OSError as error:
            manifest.damage = f"{path.name} cannot be read ({error.strerror})"
            return manifest
        for number, line in enumerate(content.split(b"\n")[:-1], 1):
            try:
                if len(line) > LONGEST_LINE:
                    raise ValueError(f"a line of {len(line)} bytes, more than the {LONGEST_LINE} that are allowed")
                facts = json.loads(line)
                stated = facts.pop("chain")
                if stated != manifest._chain(facts):
                    raise ValueError("the chain of hashes is broken")
                manifest.foreign = True
                _check_types(facts)
                manifest.foreign = False
            except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
                manifest.damage = f"{path.name} cannot be trusted from line {number} on ({error})"
                return manifest
            manifest.lines.append({**facts, "chain": stated})
        if not content.endswith(b"\n") or not manifest.lines:
            manifest.damage = f"{path.name} is cut off after line {len(manifest.lines)}"
        return manifest

    def add(self, kind: str, **facts: Any) -> None:
        """One more line, not yet on disk."""
        line = {"kind": kind, **facts}
        self.lines.append({**line, "chain": self._chain(line)})
        self.saved = False

    def save(self) -> None:
        """Replace the file, safe against a loss of power. Raises OSError."""
        atomic_write(self.path, "".join(json.dumps(line, sort_keys=True) + "\n" for line in self.lines))
        self.saved = True

    @property
    def segments(self) -> dict[str, Facts]:
        """What each closed segment has to be, by name of its file."""
        return {line["name"]: line for line in self.lines if line["kind"] == "segment"}

    @property
    def removed(self) -> dict[str, str]:
        """Segments that were removed for room or lost with their disk, and why, by name."""
        return {line["name"]: line["reason"] for line in self.lines if line["kind"] in ("removed", "lost")}

    @property
    def lost(self) -> set[str]:
        """Segments whose file was taken away while it was written; the next segment begins with that gap."""
        return {line["name"] for line in self.lines if line["kind"] == "lost"}

    @property
    def ticks(self) -> dict[str, int]:
        """How many ticks each closed segment has to hold, or went with a lost one, by name."""
        return {line["name"]: line["ticks"] for line in self.lines if line["kind"] in ("segment", "lost")}

    def told(self) -> Told:
        """All of it as it is now."""
        return Told(self.segments, self.removed, self.lost, self.ticks)

    @property
    def marks(self) -> list[Facts]:
        """The marks that were left: from_ns, to_ns and reason."""
        return [line for line in self.lines if line["kind"] == "mark"]

    def marked(self, names: Iterable[str]) -> set[str]:
        """Those of these segments that lie within what a mark preserves; one that is not closed may lie in any."""
        segments, kept = self.segments, _joined((mark["from_ns"], mark["to_ns"]) for mark in self.marks)

        def is_marked(name: str) -> bool:
            span = segments.get(name)
            if span is None:
                return bool(kept)
            before = bisect_right(kept, (span["last_ns"], FAR))  # the last that begins before the segment ends
            return before > 0 and span["first_ns"] <= kept[before - 1][1]

        return set(filter(is_marked, names))

    def _chain(self, facts: Mapping[str, Any]) -> str:
        before = self.lines[-1]["chain"] if self.lines else ""
        text = json.dumps(facts, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(f"{before}{text}".encode()).hexdigest()


def _joined(spans: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """Spans in order, those that overlap as one, so that one question finds whether any of many holds."""
    joined: list[tuple[int, int]] = []
    for begin, end in sorted((min(span), max(span)) for span in spans):
        if joined and begin <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(end, joined[-1][1]))
        else:
            joined.append((begin, end))
    return joined


def _check_types(facts: Facts) -> None:
    """Raises ValueError where a line says what no line of its kind does."""
    expected = KINDS.get(facts["kind"]) if isinstance(facts.get("kind"), str) else None
    if expected is None:
        raise ValueError(f"a line of kind {facts.get('kind')!r:.40}")
    for key, type_ in expected.items():
        if type(facts.get(key)) is not type_:
            raise ValueError(f"{key} is {facts.get(key)!r:.40}, expected {type_.__name__}")
        if type_ is int and not -FAR <= facts[key] <= FAR:
            raise ValueError(f"{key} is {facts[key]!r:.40}, which no run reaches")
