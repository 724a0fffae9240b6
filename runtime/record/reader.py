"""A recorded run, read from its start up to where it can be believed."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.errors import NotARunError
from runtime.messages.estimate import decode_estimate
from runtime.messages.ros import decode_ranges_m
from runtime.messages.tick import (
    Gap,
    Record,
    decode_defect,
    decode_gap,
    decode_state_hash,
    decode_tick,
    decode_timing,
    decode_truth,
    encode_gap,
)
from runtime.record.folder import CLOSED_NAME, RunFolder
from runtime.record.header import RunHeader
from runtime.record.manifest import Manifest
from runtime.record.mcap_prefix import McapPrefix
from runtime.tick import Tick, Timing
from slam.estimate import Estimate
from slam.pose import Pose2

LOSSES_SHOWN = 3
OUTCOMES = frozenset(("/estimate", "/pose", "/odom", "/timing", "/state_hash", "/truth", "/defect"))


@dataclass(frozen=True, slots=True)
class RecordedTick:
    """One tick as it came in and, where it was recorded, what came of it.

    inputs: the records that the tick was decoded from, for whoever writes it again unchanged.
    outcomes: the others by topic, decoded only when asked for. gaps: what the record had lost before this tick.
    """

    tick: Tick
    inputs: list[Record]
    gaps: list[Gap]
    outcomes: dict[str, Record] = field(default_factory=dict)

    @property
    def estimate(self) -> Estimate | None:
        """What the estimator said."""
        record = self.outcomes.get("/estimate")
        return None if record is None else decode_estimate(record.data)

    @property
    def timing(self) -> Timing | None:
        """How the loop kept time."""
        record = self.outcomes.get("/timing")
        return None if record is None else decode_timing(record.data)

    @property
    def state_hash(self) -> bytes | None:
        """Hash of the filter's state after the tick."""
        record = self.outcomes.get("/state_hash")
        return None if record is None else decode_state_hash(record.data)

    @property
    def truth(self) -> Pose2 | None:
        """Where a simulated rover really was."""
        record = self.outcomes.get("/truth")
        return None if record is None else decode_truth(record.data)

    @property
    def defect(self) -> str:
        """Why the step raised and ended as a prediction, "" where it did not."""
        record = self.outcomes.get("/defect")
        return "" if record is None else decode_defect(record.data)


class RunReader:
    """Opens a run folder, or a run.mcap; the segments of a long run are read as one.

    Raises NotARunError when there is no run or its head cannot be read. A run that ends early gives all its whole
    ticks, and `truncated` says so once they have been read. Where a segment is damaged or gone, reading goes on with
    the next one after a gap. `gaps` are all losses so far.
    """

    def __init__(self, path: Path) -> None:
        self.folder = RunFolder.open(path)
        self._paths = self.folder.segment_paths()
        self._file, self.header = _first_header(self._paths)
        self.attachments: Mapping[str, bytes] = self._file.attachments
        self.gaps: list[Gap] = []
        self._size = sum(path.stat().st_size for path in self._paths)
        self._size_before = 0
        self.known_losses: list[str] = []  # segments that the manifest says are gone, for example for room
        self._losses: list[str] = []
        self._ticks = 0
        self._last_stamp_ns: int | None = None

    @property
    def read_fraction(self) -> float:
        """Share of the run that has been read, for a progress bar."""
        return (self._size_before + self._file.offset) / self._size

    @property
    def damages(self) -> list[str]:
        """What is not as it was written; known after reading to the end."""
        return [loss for loss in self._losses if loss not in self.known_losses]

    @property
    def truncated(self) -> str:
        """One sentence when the run is not whole, "" when it is; known after reading to the end."""
        if not self._losses:
            return ""
        until = "none" if self._last_stamp_ns is None else f"the last one at {self._last_stamp_ns * 1e-9:.3f} s"
        what = self._paths[0] if len(self._paths) == 1 else self.folder.path
        more = len(self._losses) - LOSSES_SHOWN
        why = "; ".join(self._losses[:LOSSES_SHOWN]) + (f"; and {more} more, see infant log verify" if more > 0 else "")
        return f"{what} is not whole ({why}): {self._ticks} whole ticks can be read, {until}"

    def records(self) -> Iterator[Record]:
        """Every message of the run in the order of writing, with a gap where something is missing between segments."""
        manifest = Manifest.load(self.folder.manifest_path)
        self._losses, self.known_losses, self._size_before = [], [], 0
        stamp_ns, expected, missing_ticks = 0, 1, 0  # missing_ticks: for which no gap has been given yet
        for index, path in enumerate(self._paths):
            ticks = 0
            self._size_before += self._file.size if index else 0
            self._file = file = McapPrefix(path)
            number = self._number(file)
            for absent in range(expected, number):
                name = RunFolder.closed_name(absent)
                reason = manifest.removed.get(name, "nobody knows why")
                self._losses.append(f"{name} is gone: {reason}")
                self.known_losses += self._losses[-1:] if name in manifest.removed else []
                if name not in manifest.lost or absent + 1 < number:  # else this segment begins with that gap
                    missing_ticks += manifest.ticks(name, 1)
            expected = max(expected, number + 1)
            if not file.damage and missing_ticks:
                yield encode_gap(Gap(stamp_ns, missing_ticks, 0, self._losses[-1]))
                missing_ticks = 0
            for topic, log_ns, data in file.messages() if not file.damage else ():
                ticks += topic == "/tick"
                stamp_ns = log_ns
                yield Record(topic, log_ns, data)
            if file.damage:
                name = "" if len(self._paths) == 1 else f"{path.name}: "
                self._losses.append(f"{name}{file.damage} of {file.size}")
                missing_ticks += max(1, manifest.ticks(path.name, 0) - ticks)
        missing = manifest.segments.keys() - manifest.removed.keys() - {path.name for path in self._paths}
        last = [name for name in sorted(missing) if manifest.segments[name]["number"] >= expected]
        self._losses += [f"{name} is gone: nobody knows why" for name in last]
        if not last and self._paths[-1].name != "run.mcap" and not self._losses:
            self._losses.append(f"the recording was cut off after {self._paths[-1].name}")

    def _number(self, file: McapPrefix) -> int:
        """Which segment this is; leaves damage in a file that does not belong to the run."""
        file.read_head()
        if "segment" in file.metadata:
            facts, mine = file.metadata.get("infant", {}), self.header
            if (facts.get("configuration_sha256"), facts.get("boot_id"), facts.get("created_utc")) == (
                mine.configuration_sha256,
                mine.boot_id,
                mine.created_utc,
            ):
                return int(file.metadata["segment"]["number"])
            file.damage = "a file of another run at byte 0"
        match = CLOSED_NAME.fullmatch(file.path.name)
        return int(match[1]) if match else 0

    def ticks(self) -> Iterator[RecordedTick]:
        """Every whole tick.

        Only one tick is held at a time. A tick is whole by construction: its records are never parted by a chunk.
        """
        self._ticks, self._last_stamp_ns, self.gaps = 0, None, []
        current: RecordedTick | None = None
        scan: Record | None = None
        gaps: list[Gap] = []
        for record in self.records():
            if record.topic in ("/scan", "/tick") and current is not None:
                yield self._counted(current)
                current = None
            if record.topic == "/scan":
                scan = record
            elif record.topic == "/tick":
                current = _recorded_tick(record, scan, gaps)
                scan, gaps = None, []
            elif record.topic == "/gap":
                gaps.append(decode_gap(record.data))
                self.gaps.append(gaps[-1])
            elif current is not None and record.topic == "/diagnostics":
                current.inputs.append(record)
            elif current is not None and record.topic in OUTCOMES:
                current.outcomes[record.topic] = record
        if current is not None:
            yield self._counted(current)

    def _counted(self, recorded: RecordedTick) -> RecordedTick:
        self._ticks += 1
        self._last_stamp_ns = recorded.tick.stamp_ns
        return recorded


def _first_header(paths: list[Path]) -> tuple[McapPrefix, RunHeader]:
    """The first head that can be believed; every segment has the same. Raises NotARunError."""
    refusals: list[tuple[Path, str, Exception]] = []
    for path in paths:
        file = McapPrefix(path)
        file.read_head()
        try:
            return file, RunHeader.from_metadata(file.metadata)
        except (ValueError, KeyError) as error:
            refusals.append((path, file.damage or str(error), error))
    path, why, cause = refusals[0]
    raise NotARunError(f"{path} cannot be read as a run: {why}; nothing in it can be trusted") from cause


def _recorded_tick(record: Record, scan: Record | None, gaps: list[Gap]) -> RecordedTick:
    ranges_m: NDArray[np.float32] | None = None if scan is None else decode_ranges_m(scan.data)
    inputs = [record] if scan is None else [scan, record]
    return RecordedTick(decode_tick(record.data, ranges_m), inputs, gaps)
