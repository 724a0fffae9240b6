"""A recorded run, read from its start up to where it can be believed."""

from collections.abc import Callable, Collection, Iterator, Mapping
from itertools import groupby
from pathlib import Path

from runtime.errors import NotARunError
from runtime.messages.decoding import Before, check, decoded
from runtime.messages.definitions import TYPES, deserialize
from runtime.messages.recorded_tick import OUTCOMES, RecordedTick
from runtime.messages.ros import decode_ranges_m
from runtime.messages.tick import Gap, Record, decode_gap, decode_tick, encode_gap
from runtime.printable import printable
from runtime.record.folder import CLOSED_NAME, MOST_SEGMENTS, RunFolder
from runtime.record.header import first_header, segment_number
from runtime.record.manifest import Manifest, Told
from runtime.record.mcap_prefix import Channel, McapPrefix
from runtime.record.room import is_being_written

LOSSES_SHOWN = 3
MOST_LOSSES = 1000  # sentences kept; a run that is worse is no better known for more of them
CDR_HEADER = b"\0\1\0\0"  # little-endian; of every message that a recorder writes
FAR = 1 << 62  # ns: a stamp that no clock of a rover shows
OF_TICKS = OUTCOMES | {"/scan", "/tick", "/gap", "/diagnostics"}
WITH_RAW_LASER = OF_TICKS | {"/raw/laser"}


class RunReader:
    """Opens a run folder, or a run.mcap; the segments of a long run are read as one.

    Raises NotARunError when there is no run or its head cannot be read. A run that ends early gives all its whole
    ticks, and `truncated` says so once they have been read. Where a segment is damaged or gone, reading goes on with
    the next one after a gap. `gaps` are all losses so far.

    What damage cannot do to a run, bytes with right checksums that no recorder writes, raises NotARunError too, while
    reading as well; with `tolerant` it is a damage like others and passed over.
    """

    def __init__(self, path: Path, tolerant: bool = False) -> None:
        self.folder, self._tolerant = RunFolder.open(path), tolerant
        self._paths = self.folder.segment_paths()
        self._file, self.header = first_header(self._paths)
        self.attachments: Mapping[str, bytes] = self._file.attachments
        self.gaps: list[Gap] = []
        self._size = max(1, sum(path.stat().st_size for path in self._paths))
        self.known_losses: list[str] = []  # segments that the manifest says are gone, for example for room
        self._losses: list[str] = []
        self._alike = "", ""  # the segment from which on all are damaged alike, and how
        self.cut_off = False  # the last file ends where a recorder was killed: that is the last of the damages
        self._ticks = self._size_before = 0
        self._span_ns: tuple[int, int] | None = None  # stamps of the first and the last tick
        for name in self.folder.foreign_segments():
            self._refuse(self.folder.path / name, f"a run has at most {MOST_SEGMENTS} segments; move the file away")
        manifest = Manifest.load(self.folder.manifest_path)
        if manifest.foreign:
            self._refuse(self.folder.path, f"{manifest.damage}; a run without {manifest.path.name} can be read")
        if self._file.foreign:
            self._refuse(self._file.path, str(self._file.damage))

    @property
    def place(self) -> str:
        """Where reading has come to: file and byte."""
        return f"{self._file.path}, byte {self._file.offset}"

    @property
    def channels(self) -> Mapping[str, Channel]:
        """What the file says of the topics that it holds, known before their first record."""
        return self._file.channels

    @property
    def read_fraction(self) -> float:
        """Share of the run that has been read, for a progress bar."""
        return min(1.0, (self._size_before + self._file.offset) / self._size)  # a run that is recorded has grown

    @property
    def damages(self) -> list[str]:
        """What is not as it was written; known after reading to the end."""
        known = frozenset(self.known_losses)
        return [loss for loss in self._losses if loss not in known]

    @property
    def truncated(self) -> str:
        """One sentence when the run is not whole, "" when it is; known after reading to the end."""
        if not self._losses:
            return ""
        begin_ns, end_ns = self._span_ns or (0, 0)
        until = f"the last one {(end_ns - begin_ns) * 1e-9:.1f} s after the first" if self._span_ns else "none"
        what = self._paths[0] if len(self._paths) == 1 else self.folder.path
        more = len(self._losses) - LOSSES_SHOWN
        why = "; ".join(self._losses[:LOSSES_SHOWN]) + (f"; and {more} more, see infant log verify" if more > 0 else "")
        return f"{what} is incomplete ({why}): {self._ticks} complete ticks can be read, {until}"

    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """Every message of the run in the order of writing, with a gap where something is missing between segments.

        topics: the only ones that are given, /tick among them; with `tolerant` all, to be checked.
        """
        topics = None if self._tolerant else topics
        told = Manifest.load(self.folder.manifest_path).told()
        self._losses, self.known_losses, self._size_before, self._alike, self.cut_off = [], [], 0, ("", ""), False
        self._ticks, self._span_ns = 0, None
        stamp_ns, expected, missing_ticks = 0, 1, 0  # missing_ticks: for which no gap has been given yet
        is_recorded = is_being_written(self.folder.mcap_path)
        for index, path in enumerate(self._paths_now()):
            ticks = 0
            self._size_before += self._file.size if index else 0
            self._file = file = McapPrefix(path)
            number = self._number(file)
            if number > expected:
                missing_ticks += self._note_absent(expected, number, told)
            expected = max(expected, number + 1)
            if not file.damage and missing_ticks:
                yield encode_gap(Gap(stamp_ns, missing_ticks, 0, self._losses[-1]))
                missing_ticks = 0
            for record in self._believable(file, topics) if not file.damage else ():
                stamp_ns = record.stamp_ns
                if record.topic == "/tick":
                    ticks, self._ticks = ticks + 1, self._ticks + 1
                    self._span_ns = stamp_ns if self._span_ns is None else self._span_ns[0], stamp_ns
                yield record
            if file.damage:
                self.cut_off = file.cut_off and path == self._paths[-1] and path.name not in told.segments
                if self.cut_off and is_recorded:
                    self.cut_off = False
                    self.known_losses.append("the run is still being recorded")
                    self._losses.append(self.known_losses[-1])
                else:
                    self._note_damage(file)
                missing_ticks += max(1, told.ticks.get(path.name, 0) - ticks)
            if file.foreign:
                self._refuse(path, str(file.damage))
        missing = told.segments.keys() - told.removed.keys() - {path.name for path in self._paths}
        last = [name for name in sorted(missing) if told.segments[name]["number"] >= expected]
        self._losses += [f"{name} is missing for an unknown reason" for name in last]
        if not last and self._paths[-1].name != "run.mcap" and not self._losses:
            self._losses.append(f"the recording was cut off after {self._paths[-1].name}")
            self.cut_off = True

    def _paths_now(self) -> Iterator[Path]:
        """Of every segment, with those that a recorder has closed while the others were read."""
        yield from (read := self._paths[:-1])
        known = set(read)
        self._paths = read + [path for path in self.folder.segment_paths() if path not in known] or self._paths
        yield from self._paths[len(read) :]

    def _believable(self, file: McapPrefix, topics: Collection[str] | None) -> Iterator[Record]:
        """Records of one file; with `tolerant` a gap in place of ticks that say nothing and of what came of them."""
        before, wrong, skips = Before(), 0, False
        for topic, log_ns, data in file.messages(topics):
            record = Record(topic, min(log_ns, FAR), data)
            begins = topic in ("/scan", "/tick")
            try:
                if topic in TYPES and not data.startswith(CDR_HEADER):
                    decoded(record, lambda data: deserialize(TYPES[topic], data), self.place)  # noqa: B023 called here
                if self._tolerant:
                    check(record, before, self.place)
            except NotARunError as error:
                if not self._tolerant:
                    raise
                self._losses += [str(error)] if len(self._losses) < MOST_LOSSES else []
                before = Before()
                wrong, skips = wrong + (topic == "/tick"), skips or topic == "/tick"
                continue
            if begins and wrong:
                yield encode_gap(Gap(record.stamp_ns, wrong, 0, "invalid ticks"))
                wrong = 0
            skips &= not begins
            if not skips:
                yield record

    def _note_damage(self, file: McapPrefix) -> None:
        """Say what is wrong with a segment; neighbours that are damaged alike are told together."""
        name, (first, damage) = file.path.name, self._alike
        if len(self._paths) == 1:
            self._losses.append(f"{file.damage} of {file.size}")
        elif damage == file.damage and self._losses and self._losses[-1].startswith(first):
            self._losses[-1] = f"{first} to {name}: {damage}"
        else:
            self._losses.append(f"{name}: {file.damage} of {file.size}")
            self._alike = name, file.damage or ""

    def _note_absent(self, expected: int, number: int, told: Told) -> int:
        """Say which segments before `number` are gone, those of one reason together; returns ticks without a gap."""
        ticks = 0
        names = [RunFolder.closed_name(absent) for absent in range(expected, number)]
        for reason, group in groupby(names, lambda name: told.removed.get(name, "unknown reason")):
            gone = list(group)
            what = f"{gone[0]} is missing" if len(gone) == 1 else f"{gone[0]} to {gone[-1]} are missing"
            self._losses.append(f"{what}: {printable(reason)}")
            self.known_losses += self._losses[-1:] if gone[0] in told.removed else []
            # the segment after a lost one begins with that gap
            ticks += sum(told.ticks.get(name, 1) for name in gone if name not in told.lost or name != names[-1])
        return ticks

    def _refuse(self, path: Path, why: str) -> None:
        """Raises NotARunError for what no recorder writes, unless such a thing is to be passed over."""
        if not self._tolerant:
            raise NotARunError(f"{path} is not a valid run: {why}; see infant log verify")

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
                try:
                    return segment_number(file.metadata) or 0
                except ValueError as error:
                    file.damage, file.foreign = f"{error} at byte 0", True
                    self._refuse(file.path, file.damage)
            else:
                file.damage = "a file of another run at byte 0"
        match = CLOSED_NAME.fullmatch(file.path.name)
        return int(match[1]) if match else 0

    def ticks(self, raw_laser: Callable[[bytes], None] | None = None) -> Iterator[RecordedTick]:
        """Every whole tick. raw_laser: a decoder that takes the laser's own bytes as they pass.

        Only one tick is held at a time. A tick is whole by construction: its records are never parted by a chunk.
        """
        self.gaps = []
        current: RecordedTick | None = None
        scan: Record | None = None
        gaps: list[Gap] = []
        for record in self.records(OF_TICKS if raw_laser is None else WITH_RAW_LASER):
            if record.topic in ("/scan", "/tick") and current is not None:
                yield current
                current = None
            if record.topic == "/scan":
                scan = record
            elif record.topic == "/tick":
                current = self._recorded_tick(record, scan, gaps)
                scan, gaps = None, []
            elif record.topic == "/gap":
                gaps.append(decoded(record, decode_gap, self.place))
                self.gaps.append(gaps[-1])
            elif current is not None and record.topic == "/diagnostics":
                current.inputs.append(record)
            elif current is not None and record.topic in OUTCOMES:
                current.outcomes[record.topic] = record
            elif raw_laser is not None and record.topic == "/raw/laser":
                decoded(record, raw_laser, self.place)
        if current is not None:
            yield current

    def _recorded_tick(self, record: Record, scan: Record | None, gaps: list[Gap]) -> RecordedTick:
        ranges_m = None if scan is None else decoded(scan, decode_ranges_m, self.place)
        tick = decoded(record, lambda data: decode_tick(data, ranges_m), self.place)
        return RecordedTick(tick, [record] if scan is None else [scan, record], gaps, self.place)
