"""The record's side of the disk: chunks, segments, room and marks. Each trouble is a state that names its cause."""

import os
from collections.abc import Callable, Iterable
from pathlib import Path

from drivers.measurements import Event, Severity
from runtime.errors import StorageError
from runtime.messages.ros import encode_events
from runtime.messages.tick import Record
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.marks import take_marks
from runtime.record.room import FULL, make_room
from runtime.record.segments import Segments
from runtime.settings.record import RecordSettings

PENDING_BYTES = 8 << 20  # a minute of chunks that a disk refuses; beyond that the newest are lost and counted
WAKE_S = 0.1  # the writer gathers instead of waking for every frame: each wake takes the loop's interpreter lock
CHUNK_NS = 300_000_000  # with WAKE_S less than half a second is in memory when the process is killed
CHUNK_BYTES = 4 << 20  # what waits behind a disk that stands must not become a chunk that no reader takes
SYNC_NS = 1_000_000_000
ROOM_NS = 5_000_000_000
RETRY_NS = 500_000_000
MOVED = "the run is on another file system than at its start; was its disk unplugged?"


class Storage:
    """Owned by the recorder's thread; nothing here raises once it has been made.

    segment_closed: told the number of a segment and the time when another has been begun.
    """

    def __init__(
        self,
        folder: RunFolder,
        header: RunHeader,
        settings: RecordSettings,
        now_ns: Callable[[], int],
        segment_closed: Callable[[int, int], None],
    ) -> None:
        """Make the file and write its head. Raises StorageError."""
        self._folder = folder
        self._settings = settings
        self._now_ns = now_ns
        self._segment_closed = segment_closed
        self._segments = Segments(folder, header.metadata, round(settings.segment_s * 1e9), now_ns)
        self._troubles = {"write": "", "sync": "", "room": "", "mark": "", "place": ""}
        self._device = os.stat(folder.path).st_dev
        self._stuck_marks: set[Path] = set()  # taken, and not to be removed
        self._is_full = False
        self._chunk_began_ns = self._synced_ns = self._tried_ns = self._room_ns = now_ns()
        self._write(self._tried_ns)
        if self._troubles["write"]:
            raise StorageError(f"{folder.mcap_path}: {self._troubles['write']}; free space or check the mount")

    @property
    def troubles(self) -> tuple[str, ...]:
        """What is wrong now, a sentence each."""
        return tuple(filter(None, self._troubles.values()))

    @property
    def has_room(self) -> bool:
        """Whether memory may hold more until the disk takes it."""
        return self._segments.pending_bytes < PENDING_BYTES

    def add(self, records: list[Record]) -> None:
        """Into the chunk at hand; records of one call are never parted."""
        for record in records:
            self._segments.add(record)
        if self._segments.chunk_bytes > CHUNK_BYTES:
            self._segments.end_chunk()

    def mark(self, reason: str) -> None:
        """Keep the segments around this moment."""
        self._segments.mark(reason)

    def end_segment(self) -> None:
        """Let the next visit close the segment at hand."""
        self._segments.end_segment()
        self._chunk_began_ns = 0

    def visit_disk(self, now_ns: int) -> None:
        """Whatever is due: end the chunk and write, sync and read marks, make room. May wait for the disk."""
        if now_ns - self._chunk_began_ns >= CHUNK_NS - WAKE_S * 1e9:
            self._segments.end_chunk()
            self._chunk_began_ns = now_ns
            self._write(now_ns)
        if now_ns - self._synced_ns >= SYNC_NS:
            self._synced_ns = now_ns
            self._sync()
            self._check_place()
            self._take_marks(now_ns)
        if self._is_full or now_ns - self._room_ns >= ROOM_NS:
            self._room_ns = now_ns
            self._make_room(now_ns)

    def close(self) -> None:
        """Write everything with the index, as far as the disk lets it."""
        self._segments.finish()
        self._troubles["write"] = ""  # one more try, however recent the last one is
        self._write(self._now_ns())
        self._sync()
        try:
            self._segments.close()
        except OSError as error:
            self._troubles["write"] = f"run.mcap cannot be closed ({error.strerror})"

    def _write(self, now_ns: int) -> None:
        if self._troubles["write"] and now_ns - self._tried_ns < RETRY_NS:
            return
        self._tried_ns = now_ns
        number = self._segments.number
        try:
            self._segments.write()
            self._troubles["write"] = ""
        except OSError as error:
            self._is_full = error.errno in FULL
            self._troubles["write"] = f"run.mcap cannot be written ({error.strerror})"
        except StorageError as error:
            self._troubles["write"] = str(error)
        if self._segments.number != number:
            self._segment_closed(number, now_ns)

    def _sync(self) -> None:
        try:
            self._segments.sync()
            self._troubles["sync"] = ""
        except OSError as error:
            self._troubles["sync"] = f"run.mcap is not safely on disk ({error.strerror})"

    def _make_room(self, now_ns: int) -> None:
        try:
            made = make_room(self._folder, self._segments.manifest, self._settings, self._is_full)
            self._troubles["room"] = made.trouble
            self._note(now_ns, [Event(now_ns, "recorder", "removed", each, Severity.WARN) for each in made.removed])
        except OSError as error:
            self._troubles["room"] = f"old segments cannot be removed ({error.strerror})"
        self._is_full = False

    def _note(self, now_ns: int, events: list[Event]) -> None:
        """Into the record: what the recorder did itself."""
        if events:
            self._segments.add(encode_events(now_ns, events))

    def _check_place(self) -> None:
        """Whether the run still lies where it began: a disk that was pulled out leaves its folder to the system's."""
        try:
            moved = os.stat(self._folder.path).st_dev != self._device
        except OSError:
            moved = False  # whoever writes says what is wrong
        self._troubles["place"] = MOVED if moved else ""

    def _take_marks(self, now_ns: int) -> None:
        """A mark's file goes only when the mark is on disk; one that is seen twice is one too many, not too few."""
        try:
            marks = take_marks(self._folder)
            new = {path: reason for path, reason in marks.items() if path not in self._stuck_marks}
            for reason in new.values():
                self._segments.mark(reason)
            if new:
                self._segments.manifest.save()
            self._note(now_ns, [Event(now_ns, "recorder", "mark", reason) for reason in new.values()])
            self._stuck_marks = set(marks)
            self._troubles["mark"] = _removed(marks)
        except OSError as error:
            self._troubles["mark"] = f"a mark cannot be kept ({error.strerror})"


def _removed(marks: Iterable[Path]) -> str:
    """Remove the files of marks that are kept; what is wrong where one stays, which keeps none of the others."""
    trouble = ""
    for path in marks:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            trouble = f"{path.name}: a mark was kept and its file cannot be removed ({error.strerror})"
    return trouble
