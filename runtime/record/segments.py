"""The record of a live run as segments: run.mcap is being written, run-0001.mcap and on are closed for good.

Each segment has the whole head and is read by itself. A segment is closed when it is old enough and the disk has taken
everything; where its file is taken away a new one is opened, and what was lost becomes a record.
"""

import contextlib
import os
from collections.abc import Callable, Mapping

from runtime.atomic_write import refuse_link
from runtime.messages.tick import Gap, Record, encode_gap
from runtime.record.folder import RunFolder
from runtime.record.header import segment_number
from runtime.record.manifest import Manifest
from runtime.record.mcap_file import RecordFile
from runtime.record.mcap_prefix import McapPrefix

Metadata = Mapping[str, Mapping[str, str]]
FAR_NS = 1 << 62
MOST_MARKS = 500  # each with its reason; a person leaves some dozens
REMOVED = "run.mcap was removed while being written"


class Segments:
    """The files of one run, owned by the recorder's thread. Only write, sync and close touch the disk."""

    def __init__(self, folder: RunFolder, metadata: Metadata, segment_ns: int, now_ns: Callable[[], int]) -> None:
        """Open the first segment. Raises StorageError."""
        self.folder = folder
        self.manifest = Manifest(folder.manifest_path)
        self.manifest.add("run", created_utc=metadata.get("infant", {}).get("created_utc", ""))
        self._metadata = metadata
        self._segment_ns = segment_ns
        self._now_ns = now_ns
        self._number = 0
        self._unwritten: list[Record] = []  # in the file at hand, but not taken by the disk
        self._held: list[Record] = []  # for the next file
        self._held_bytes = 0
        self._finished = self._ending = self._unsafe = self._asked_to_end = False
        self._reported_gone = False
        self._file: RecordFile | None = None
        self._begin(*self._create())

    @property
    def number(self) -> int:
        """Of the segment that is being written."""
        return self._number

    @property
    def pending_bytes(self) -> int:
        """Bytes that the disk has not taken yet."""
        return self._held_bytes + (self._file.pending_bytes if self._file is not None else 0)

    @property
    def chunk_bytes(self) -> int:
        """Bytes in the chunk that is not finished."""
        return self._file.chunk_bytes if self._file is not None else 0

    def mark(self, reason: str) -> None:
        """Preserve this moment: the segment at hand, the one before and the one after. On disk with the next write.

        Of very many, all but one a segment have their reason in the log only: the manifest is written anew for each.
        """
        now_ns, marks = self._now_ns(), self.manifest.marks
        if len(marks) >= MOST_MARKS and now_ns - marks[-1]["stamp_ns"] < self._segment_ns:
            return
        segments = 1 if len(marks) + 1 < MOST_MARKS else 2  # for those that come within the next one
        facts = {"from_ns": now_ns - self._segment_ns, "to_ns": now_ns + segments * self._segment_ns}
        self.manifest.add("mark", stamp_ns=now_ns, **facts, reason=reason)

    def end_segment(self) -> None:
        """Let the next write close the segment at hand, however young it is, and begin another."""
        self.end_chunk()
        self._asked_to_end = True

    def add(self, record: Record) -> None:
        """Into the chunk at hand; while a segment is being closed, into the next one."""
        if self._file is None or self._finished:
            self._held.append(record)
            self._held_bytes += len(record.data)
        else:
            self._put(self._file, record)

    def end_chunk(self) -> None:
        """All records so far become a chunk."""
        if self._file is not None and not self._finished and not self._file.is_torn:
            self._file.end_chunk()

    def write(self) -> None:
        """Give the disk what it has not taken, then close the segment if it is time. Raises OSError, StorageError.

        To be called after end_chunk. Call again to go on where it stopped.
        """
        file = self._file or self._begin(*self._create())
        if file.is_gone():
            if not self._reported_gone:  # a state first: what is unplugged for a moment may be back at the next try
                self._reported_gone = True
                raise FileNotFoundError(2, "it was removed while being written")
            file = self._replace(file)
        elif file.is_torn and not self._finished:
            file = self._set_aside(file)
        self._reported_gone = False
        file.write()
        if not self._finished:
            self._unwritten.clear()
            old = self._now_ns() - self._opened_ns >= self._segment_ns
            if self._ending or self._unsafe or self._asked_to_end or old:
                file.finish()
                self._finished = True
        if self._finished:
            self._close_segment(file)
        if not self.manifest.saved:
            self.manifest.save()

    def sync(self) -> None:
        """Make sure that a loss of power takes nothing of what is written. Raises OSError.

        After a refusal nobody knows which of the bytes are on disk: the segment is closed, and its hash will tell.
        """
        if self._file is None:
            return
        try:
            self._file.sync()
        except FileNotFoundError:
            raise
        except OSError:
            self._unsafe = True
            raise

    def finish(self) -> None:
        """After this the next write ends the record."""
        self.end_chunk()
        self._ending = True

    def close(self) -> None:
        """Give the file back to the system if the disk did not let it end well. Raises OSError."""
        if self._file is not None:
            self._file.close()

    def _create(self) -> tuple[RecordFile, int]:
        """A new run.mcap and its number; a segment that was cut off makes way for it. Raises OSError, StorageError."""
        refuse_link(self.folder.path)  # somebody may have put one in place of the folder that was made
        self.folder.path.mkdir(parents=True, exist_ok=True)
        number = max([self._number, *self.folder.closed_segments()]) + 1
        path = self.folder.mcap_path
        if self._number and path.exists():  # a disk is back, with what was written on it until it went
            cut = McapPrefix(path)
            cut.read_head()
            old = self.folder.closed_path(number)
            with contextlib.suppress(ValueError):  # somebody else's file has been put there meanwhile
                old = self.folder.closed_path(segment_number(cut.metadata) or number)
            os.rename(path, self.folder.closed_path(number) if old.exists() else old)
            number = max([self._number, *self.folder.closed_segments()]) + 1
        return RecordFile(path, {**self._metadata, "segment": {"number": str(number)}}), number

    def _begin(self, file: RecordFile, number: int) -> RecordFile:
        """Go on in a new file, with the records that had to wait for it."""
        self._file, self._number = file, number
        self._opened_ns = self._now_ns()
        self._first_ns, self._last_ns = FAR_NS, 0
        self._ticks = self._raw = 0
        self._finished = self._unsafe = self._asked_to_end = False
        held, self._held, self._held_bytes = self._held, [], 0
        for record in held:
            self._put(file, record)
        file.end_chunk()
        return file

    def _replace(self, gone: RecordFile) -> RecordFile:
        """Go on without a file that is gone; what the disk had not taken is saved, what was lost becomes a record."""
        rescued = self._unwritten
        ticks = self._ticks - sum(record.topic == "/tick" for record in rescued)
        raw = self._raw - sum(record.topic.startswith("/raw") for record in rescued)
        name = self.folder.closed_path(self._number).name
        file, number = self._create()
        self.manifest.add("lost", name=name, ticks=ticks, reason=REMOVED)
        self._held = [encode_gap(Gap(self._now_ns(), ticks, raw, REMOVED)), *rescued, *self._held]
        self._unwritten = []
        with contextlib.suppress(OSError):  # it is gone whatever the system says about it
            gone.close()
        return self._begin(file, number)

    def _set_aside(self, torn: RecordFile) -> RecordFile:
        """Go on without a file in which something was raised: it ends with what the disk has, another has the rest."""
        self._held, self._unwritten = [*self._unwritten, *self._held], []
        file = self._begin(*self._create())
        with contextlib.suppress(OSError):
            torn.close()
        return file

    def _put(self, file: RecordFile, record: Record) -> None:
        if not file.is_torn:
            file.add(record)
        self._unwritten.append(record)
        self._ticks += record.topic == "/tick"
        self._raw += record.topic.startswith("/raw")
        self._first_ns = min(self._first_ns, record.stamp_ns)
        self._last_ns = max(self._last_ns, record.stamp_ns)

    def _close_segment(self, file: RecordFile) -> None:
        """Make the file whole and give it its name; a step that is refused is done again by the next write."""
        file.write()
        file.sync()
        path = self.folder.mcap_path
        if not self._ending:
            path = self.folder.closed_path(self._number)
            file.protect()
            os.rename(self.folder.mcap_path, path)
        self.manifest.add(
            "segment",
            name=path.name,
            number=self._number,
            bytes=file.size,
            sha256=file.sha256,
            first_ns=min(self._first_ns, self._last_ns),
            last_ns=self._last_ns,
            ticks=self._ticks,
        )
        self._file = None
        file.close()
        if not self._ending:
            self._begin(*self._create()).write()
