"""The recorder: takes what the loop and the wires give, and writes it to run.mcap on a thread of its own."""

import struct
import threading
import time
from collections.abc import Callable, Mapping
from queue import SimpleQueue

from drivers.measurements import Event
from runtime.commands import Command, asked
from runtime.errors import StorageError
from runtime.messages.map_json import landmark_json
from runtime.messages.pipe import SEGMENT
from runtime.messages.records import tick_records, warm_up
from runtime.messages.ros import encode_can_frame, encode_events
from runtime.messages.tick import Gap, LaserBytes, Record, encode_gap, encode_laser_bytes
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.marks import take_marks
from runtime.record.room import FULL, make_room
from runtime.record.segments import Segments
from runtime.service.thread_watch import no_sign
from runtime.settings.record import RecordSettings
from runtime.tick import SinkHealth, Tick, Timing
from slam.estimate import Estimate, LandmarkMap
from slam.pose import Pose2

QUEUE_ITEMS = 6000  # 50 s of 10 ticks, 10 scans' bytes and 100 CAN frames a second: longer than any disk should stall
PENDING_BYTES = 8 << 20  # a minute of chunks that a disk refuses; beyond that the newest are lost and counted
WAKE_S = 0.1  # the writer gathers instead of waking for every frame: each wake takes the loop's interpreter lock
CHUNK_NS = 300_000_000  # with WAKE_S less than half a second is in memory when the process is killed
SYNC_NS = 1_000_000_000
ROOM_NS = 5_000_000_000
RETRY_NS = 500_000_000
CLOSE_S = 2.0
SLOW_DISK_S = 2.0  # a card that clears a block takes one
STOPPED = "the recording was stopped by command"

TickItem = tuple[Tick, Estimate, Timing, bytes, Pose2 | None]
CanItem = tuple[int, int, int, bytes]
Item = TickItem | CanItem | LaserBytes


class Recorder:
    """Sink of the loop and tap of the wires. No trouble with storage ever reaches the caller: it is a state.

    tee: is given every record that is encoded, on the recorder's thread; the review is made from it.
    Values that are put must not change afterwards.
    """

    def __init__(
        self,
        folder: RunFolder,
        configuration_toml: str,
        versions: Mapping[str, str],
        tee: Callable[[Record], None] | None = None,
        now_ns: Callable[[], int] = time.monotonic_ns,
        settings: RecordSettings | None = None,
        alive: Callable[[], None] = no_sign,
    ) -> None:
        """Make the file and write its head. alive: called whenever the thread gets round. Raises StorageError."""
        warm_up()
        folder.write_configuration(configuration_toml)
        self._folder = folder
        header = RunHeader.of_live_run(configuration_toml, versions)
        self._now_ns = now_ns
        self._tee = tee
        self._settings = settings = settings or RecordSettings()
        self._file = Segments(folder, header.metadata, round(settings.segment_s * 1e9), now_ns)
        self._queue: SimpleQueue[Item] = SimpleQueue()
        self._stop = threading.Event()
        self._troubles = {"encode": "", "write": "", "sync": "", "room": "", "mark": "", "map": ""}
        self._dropped_ticks = 0
        self._dropped_raw = 0
        self._told = (0, 0)
        self._stopped = False  # by command
        self._landmarks: tuple[int, LandmarkMap] | None = None
        self._is_full = False
        self._alive = alive
        self._at_disk_ns: int | None = None  # since when the thread waits for it
        self._chunk_began_ns = self._synced_ns = self._tried_ns = self._room_ns = now_ns()
        self._write(self._tried_ns)
        if self._troubles["write"]:
            raise StorageError(f"{folder.mcap_path}: {self._troubles['write']}; free space or check the mount")
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def put(self, tick: Tick, estimate: Estimate, timing: Timing, state_hash: bytes, truth: Pose2 | None) -> None:
        """One tick; takes microseconds and never blocks."""
        if self._stopped:
            return
        if self._queue.qsize() < QUEUE_ITEMS:
            self._queue.put((tick, estimate, timing, state_hash, truth))
        else:
            self._dropped_ticks += 1

    def laser_bytes(self, stamp_ns: int, sent: bool, data: bytes) -> None:
        """Bytes of the laser's wire, from the laser's thread."""
        if self._stopped:
            return
        if self._queue.qsize() < QUEUE_ITEMS:
            self._queue.put(LaserBytes(stamp_ns, sent, data))
        else:
            self._dropped_raw += 1

    def can_frame(self, stamp_ns: int, arbitration_id: int, flags: int, data: bytes) -> None:
        """One CAN frame, from the bus's thread."""
        if self._stopped:
            return
        if self._queue.qsize() < QUEUE_ITEMS:
            self._queue.put((stamp_ns, arbitration_id, flags, data))
        else:
            self._dropped_raw += 1

    def health(self) -> SinkHealth:
        """Values waiting, values lost since the start, and what the disk says."""
        return SinkHealth(self._queue.qsize(), self._dropped_ticks + self._dropped_raw, self._trouble)

    @property
    def is_excused(self) -> bool:
        """Whether the thread may be silent: it waits for the disk, or was told to end. A restart mends neither."""
        return self._at_disk_ns is not None or self._stopped

    @property
    def _trouble(self) -> str:
        if not self._thread.is_alive() and not self._stop.is_set() and not self._stopped:
            return "the recorder's thread has ended; nothing is written any more"
        at_disk_ns = self._at_disk_ns
        waited_s = 0.0 if at_disk_ns is None else (self._now_ns() - at_disk_ns) * 1e-9
        waits = f"the disk has not answered for {waited_s:.0f} s" if waited_s > SLOW_DISK_S else ""
        return "; ".join(filter(None, (STOPPED if self._stopped else "", waits, *self._troubles.values())))

    def close(self) -> None:
        """Write what is queued and the index; at most 2 s, after which the file has no index but can be read."""
        self._stop.set()
        self._thread.join(CLOSE_S)

    def _run(self) -> None:
        while not self._stopped and not self._stop.wait(WAKE_S):
            self._alive()
            self._drain(self._now_ns())
        self._drain(self._now_ns())
        self._file.finish()
        self._troubles["write"] = ""  # one more try, however recent the last one is
        self._write(self._now_ns())
        self._sync()
        try:
            self._file.close()
        except OSError as error:
            self._troubles["write"] = f"run.mcap cannot be closed ({error.strerror})"

    def _drain(self, now_ns: int) -> None:
        """Encode what waits, end the chunk when it is old enough, and let the disk have it."""
        for _ in range(self._queue.qsize()):
            if self._stopped:
                return
            self._take(self._queue.get())
        self._tell_gap()
        self._at_disk_ns = now_ns
        try:
            self._visit_disk(now_ns)
        finally:
            self._at_disk_ns = None

    def _visit_disk(self, now_ns: int) -> None:
        if now_ns - self._chunk_began_ns >= CHUNK_NS - WAKE_S * 1e9:
            self._file.end_chunk()
            self._chunk_began_ns = now_ns
            self._write(now_ns)
        if now_ns - self._synced_ns >= SYNC_NS:
            self._synced_ns = now_ns
            self._sync()
            self._take_marks(now_ns)
        if self._is_full or now_ns - self._room_ns >= ROOM_NS:
            self._room_ns = now_ns
            self._make_room()

    def _take(self, item: Item) -> None:
        try:
            records = _records(item)
        except (ValueError, TypeError, struct.error) as error:  # must not end the thread
            self._troubles["encode"] = f"a value could not be encoded ({error})"
            self._count_lost(item)
            return
        if self._tee is not None:
            for record in records:
                self._tee(record)
        if self._file.pending_bytes < PENDING_BYTES:
            self._tell_gap()
            for record in records:
                self._file.add(record)
        else:
            self._count_lost(item)
        if not isinstance(item, LaserBytes) and len(item) == 5:
            self._obey(*item[:2])

    def _obey(self, tick: Tick, estimate: Estimate) -> None:
        """Do what the tick's events ask for, now that they are in the record."""
        if estimate.landmarks is not None:
            self._landmarks = (estimate.stamp_ns, estimate.landmarks)
        for event in tick.events:
            match asked(event):
                case Command.MARK:
                    self._file.mark(event.reason)
                case Command.SAVE:
                    self._file.end_segment()
                    self._chunk_began_ns = 0  # so that the disk gets it now
                    self._save_map()
                case Command.STOP:
                    self._stopped = True

    def _save_map(self) -> None:
        if self._landmarks is None:
            return
        stamp_ns, landmarks = self._landmarks
        try:
            self._folder.write(self._folder.map_path, landmark_json(landmarks, stamp_ns).decode() + "\n")
            self._troubles["map"] = ""
        except StorageError as error:
            self._troubles["map"] = str(error)

    def _count_lost(self, item: Item) -> None:
        if isinstance(item, LaserBytes) or len(item) == 4:
            self._dropped_raw += 1
        else:
            self._dropped_ticks += 1

    def _tell_gap(self) -> None:
        """What was lost since it was last told becomes a record, as soon as there is room for one."""
        lost = (self._dropped_ticks, self._dropped_raw)
        if lost == self._told or self._file.pending_bytes >= PENDING_BYTES:
            return
        ticks, raw = lost[0] - self._told[0], lost[1] - self._told[1]
        reason = self._trouble or "the queue to the disk was full"
        self._file.add(encode_gap(Gap(self._now_ns(), ticks, raw, reason)))
        self._told = lost

    def _write(self, now_ns: int) -> None:
        if self._troubles["write"] and now_ns - self._tried_ns < RETRY_NS:
            return
        self._tried_ns = now_ns
        number = self._file.number
        try:
            self._file.write()
            self._troubles["write"] = ""
        except OSError as error:
            self._is_full = error.errno in FULL
            self._troubles["write"] = f"run.mcap cannot be written ({error.strerror})"
        except StorageError as error:
            self._troubles["write"] = str(error)
        if self._tee is not None and self._file.number != number:
            self._tee(Record(SEGMENT, now_ns, b"%d" % number))  # the review is rotated with the segments

    def _sync(self) -> None:
        try:
            self._file.sync()
            self._troubles["sync"] = ""
        except OSError as error:
            self._troubles["sync"] = f"run.mcap is not safe on disk ({error.strerror})"

    def _make_room(self) -> None:
        try:
            self._troubles["room"] = make_room(self._folder, self._file.manifest, self._settings, self._is_full)
        except OSError as error:
            self._troubles["room"] = f"old segments cannot be removed ({error.strerror})"
        self._is_full = False

    def _take_marks(self, now_ns: int) -> None:
        """A mark's file goes only when the mark is on disk; one that is seen twice is one too many, not too few."""
        try:
            marks = take_marks(self._folder)
            for reason in marks.values():
                self._file.mark(reason)
                self._file.add(encode_events(now_ns, [Event(now_ns, "recorder", "mark", reason)]))
            if marks:
                self._file.manifest.save()
            for path in marks:
                path.unlink(missing_ok=True)
            self._troubles["mark"] = ""
        except OSError as error:
            self._troubles["mark"] = f"a mark cannot be kept ({error.strerror})"


def _records(item: Item) -> list[Record]:
    if isinstance(item, LaserBytes):
        return [encode_laser_bytes(item)]
    if len(item) == 4:
        return [encode_can_frame(*item)]
    return tick_records(*item)
