"""The recorder: takes what the loop and the wires give, and writes it to run.mcap on a thread of its own."""

import time
from collections.abc import Sequence
from typing import Protocol

from drivers.measurements import Event
from drivers.stoppable_thread import StoppableThread, told
from runtime.messages.records import warm_up
from runtime.messages.tick import Gap, LaserBytes, Record, encode_gap
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.writing.intake import CanFrameItem, EventsItem, Intake, Item, Lost, records_of
from runtime.record.writing.obey import CommandObeyer
from runtime.record.writing.storage import WAKE_S, Storage
from runtime.service.thread_watch import Failures, ThreadWatch
from runtime.settings.record import RecordSettings
from runtime.tick import CompletedTick, SinkHealth

CLOSE_S = 2.0
SLOW_DISK_S = 2.0  # a card that clears a block takes one
STOPPED = "the recording was stopped by command"
DEFAULTS = RecordSettings()


class RecordObserver(Protocol):
    """Sees the record grow, on the recorder's thread; neither call may block or raise."""

    def feed(self, record: Record) -> None:
        """One record, in the order of writing."""

    def segment_closed(self, number: int, stamp_ns: int) -> None:
        """This segment was closed, and another begun."""


class Recorder:
    """Sink of the loop and tap of the wires. No trouble with storage ever reaches the caller: it is a state.

    threads: watches the recorder's thread, and has the clock. Values that are put must not change afterwards.
    """

    def __init__(
        self,
        folder: RunFolder,
        header: RunHeader,
        settings: RecordSettings = DEFAULTS,
        observers: Sequence[RecordObserver] = (),
        threads: ThreadWatch | None = None,
    ) -> None:
        """Make the file and write its head. Raises StorageError."""
        warm_up()
        threads = threads or ThreadWatch(time.monotonic_ns)
        folder.write_configuration(header.configuration_text)
        self._now_ns = threads.now_ns
        self._observers = observers
        self._storage = Storage(folder, header, settings, threads.now_ns, self._segment_closed)
        self._commands = CommandObeyer(folder, self._storage)
        self._intake = Intake()
        self._reported = Lost()  # in gaps of the record
        self._encode_trouble = ""
        self._at_disk_ns: int | None = None  # since when the thread waits for it
        self._heartbeat = threads.heartbeat("recorder")
        threads.allow_silence("recorder", lambda: self.may_be_silent)
        self._failures = Failures("recorder", threads.now_ns)
        self._has_ended = False
        self._thread = StoppableThread("recorder", self._run, failed=self._failures.note)
        self._thread.start()

    def put(self, completed: CompletedTick) -> None:
        """One tick; takes microseconds and never blocks."""
        self._put(completed)

    def laser_bytes(self, stamp_ns: int, sent: bool, data: bytes) -> None:
        """Bytes of the laser's wire, from the laser's thread."""
        self._put(LaserBytes(stamp_ns, sent, data))

    def can_frame(self, stamp_ns: int, arbitration_id: int, flags: int, data: bytes) -> None:
        """One CAN frame, from the bus's thread."""
        self._put(CanFrameItem(stamp_ns, arbitration_id, flags, data))

    def put_events(self, stamp_ns: int, events: tuple[Event, ...]) -> None:
        """Events after the last tick."""
        if events:
            self._put(EventsItem(stamp_ns, events))

    def health(self) -> SinkHealth:
        """Values waiting, values lost since the start, and what the disk says."""
        lost = self._intake.lost
        return SinkHealth(len(self._intake), lost.ticks + lost.raw, self._trouble)

    @property
    def may_be_silent(self) -> bool:
        """Whether the thread waits for the disk, or was told to end. A restart of the service mends neither."""
        return self._at_disk_ns is not None or self._commands.stopped

    def close(self) -> None:
        """Write what is queued and the index; at most 2 s, after which the file has no index but can be read."""
        self._thread.stop(CLOSE_S)
        if not self._thread.is_alive() and not self._has_ended:  # it failed just then
            self._end()

    @property
    def _trouble(self) -> str:
        stopped = self._commands.stopped
        if not self._thread.is_alive() and not self._thread.was_stopped and not stopped:
            return "the recorder's thread has ended; nothing is written any more"
        at_disk_ns = self._at_disk_ns
        waited_s = 0.0 if at_disk_ns is None else (self._now_ns() - at_disk_ns) * 1e-9
        waits = f"the disk has not answered for {waited_s:.0f} s" if waited_s > SLOW_DISK_S else ""
        troubles = (self._failures.trouble, self._encode_trouble, *self._storage.troubles, self._commands.trouble)
        return "; ".join(filter(None, (STOPPED if stopped else "", waits, *troubles)))

    def _put(self, item: Item) -> None:
        if not self._commands.stopped:
            self._intake.put(item)

    def _run(self) -> None:
        while not self._commands.stopped and not self._thread.wait(WAKE_S):
            self._heartbeat()
            self._drain()
        self._end()

    def _end(self) -> None:
        """Write what waits and finish the file."""
        self._drain()
        self._storage.close()
        self._has_ended = True

    def _drain(self) -> None:
        """Encode what waits, and let the disk have it."""
        now_ns = self._now_ns()
        for item in self._intake.waiting():
            if self._commands.stopped:
                return
            self._take(item)
        self._report_losses()
        self._at_disk_ns = now_ns
        try:
            self._storage.visit_disk(now_ns)
        finally:
            self._at_disk_ns = None

    def _take(self, item: Item) -> None:
        try:
            records = records_of(item)
        except Exception as error:  # noqa: BLE001 a value that cannot be written costs that value and not the thread
            self._encode_trouble = f"a value could not be encoded ({error!r})"
            self._failures.note(told(error))
            self._intake.lost.count(item)
            return
        for observer in self._observers:
            for record in records:
                observer.feed(record)
        if self._storage.has_room:
            self._report_losses()
            self._storage.add(records)
        else:
            self._intake.lost.count(item)
        if isinstance(item, CompletedTick):
            self._commands.obey(item)

    def _report_losses(self) -> None:
        """What was lost since the last report becomes a record, as soon as there is room for one."""
        lost, reported = self._intake.lost, self._reported
        ticks, raw = lost.ticks - reported.ticks, lost.raw - reported.raw
        if not (ticks or raw) or not self._storage.has_room:
            return
        reason = self._trouble or "the queue to the disk was full"
        self._storage.add([encode_gap(Gap(self._now_ns(), ticks, raw, reason))])
        reported.ticks, reported.raw = reported.ticks + ticks, reported.raw + raw

    def _segment_closed(self, number: int, stamp_ns: int) -> None:
        for observer in self._observers:
            observer.segment_closed(number, stamp_ns)
