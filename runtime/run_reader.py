"""A recorded run, read from its start up to where it can be believed."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from runtime.errors import NotARunError
from runtime.estimate_messages import decode_estimate
from runtime.mcap_prefix import McapPrefix
from runtime.messages import Gap, Record, decode_gap, decode_state_hash, decode_tick, decode_timing, decode_truth
from runtime.ros_messages import decode_ranges_m
from runtime.run_folder import RunFolder
from runtime.run_header import RunHeader
from runtime.tick import Tick, Timing
from slam.estimate import Estimate
from slam.pose import Pose2

OUTCOMES = frozenset(("/estimate", "/pose", "/odom", "/timing", "/state_hash", "/truth"))


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


class RunReader:
    """Opens a run folder, or a run.mcap.

    Raises NotARunError when there is no run or its head cannot be read. A run that ends early gives all its whole
    ticks, and `truncated` says so once they have been read. `gaps` are all losses told so far.
    """

    def __init__(self, path: Path) -> None:
        self.folder = RunFolder.open(path)
        self._file = McapPrefix(self.folder.mcap_path)
        self._file.read_head()
        self.header = _header(self._file)
        self.attachments: Mapping[str, bytes] = self._file.attachments
        self.gaps: list[Gap] = []
        self._ticks = 0
        self._last_stamp_ns: int | None = None

    @property
    def read_fraction(self) -> float:
        """Share of the file that has been read, for a progress bar."""
        return self._file.offset / self._file.size

    @property
    def truncated(self) -> str:
        """One sentence when the run ends early, "" when it is whole; known after reading to the end."""
        if not self._file.damage:
            return ""
        until = "none" if self._last_stamp_ns is None else f"the last one at {self._last_stamp_ns * 1e-9:.3f} s"
        return (
            f"{self._file.path} is not whole ({self._file.damage} of {self._file.size}): "
            f"{self._ticks} whole ticks can be read, {until}"
        )

    def records(self) -> Iterator[Record]:
        """Every message of the run in the order of writing."""
        self._file = McapPrefix(self.folder.mcap_path)
        for topic, stamp_ns, data in self._file.messages():
            yield Record(topic, stamp_ns, data)

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


def _header(file: McapPrefix) -> RunHeader:
    try:
        return RunHeader.from_metadata(file.metadata)
    except (ValueError, KeyError) as error:
        why = file.damage or str(error)
        raise NotARunError(f"{file.path} cannot be read as a run: {why}; nothing in it can be trusted") from error


def _recorded_tick(record: Record, scan: Record | None, gaps: list[Gap]) -> RecordedTick:
    ranges_m: NDArray[np.float32] | None = None if scan is None else decode_ranges_m(scan.data)
    inputs = [record] if scan is None else [scan, record]
    return RecordedTick(decode_tick(record.data, ranges_m), inputs, gaps)
