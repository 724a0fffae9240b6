"""Values on their way to the recorder's thread: nobody waits for it, and what it cannot take is counted."""

from collections.abc import Iterator
from dataclasses import dataclass
from queue import SimpleQueue
from typing import NamedTuple

from drivers.measurements import Event
from runtime.messages.records import tick_records
from runtime.messages.ros import encode_can_frame, encode_events
from runtime.messages.tick import LaserBytes, Record, encode_laser_bytes
from runtime.tick import CompletedTick

QUEUE_ITEMS = 6000  # 50 s of 10 ticks, 10 scans' bytes and 100 CAN frames a second: longer than any disk should stall


class CanFrameItem(NamedTuple):
    """One CAN frame with the flags of RawTap.can_frame."""

    stamp_ns: int
    arbitration_id: int
    flags: int
    data: bytes


@dataclass(frozen=True, slots=True)
class EventsItem:
    """Events that belong to no tick: the loop has ended."""

    stamp_ns: int
    events: tuple[Event, ...]


Item = CompletedTick | CanFrameItem | LaserBytes | EventsItem


@dataclass(slots=True)
class Lost:
    """Ticks and raw messages that the record lacks."""

    ticks: int = 0
    raw: int = 0

    def count(self, item: Item) -> None:
        """One more."""
        if isinstance(item, CompletedTick):
            self.ticks += 1
        else:
            self.raw += 1


class Intake:
    """The queue; put may be called on any thread and takes microseconds."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[Item] = SimpleQueue()
        self.lost = Lost()

    def __len__(self) -> int:
        return self._queue.qsize()

    def put(self, item: Item) -> None:
        """Queue it, or count it as lost."""
        if self._queue.qsize() < QUEUE_ITEMS:
            self._queue.put(item)
        else:
            self.lost.count(item)

    def waiting(self) -> Iterator[Item]:
        """What waits now, and no more: an endless stream must not keep the caller."""
        for _ in range(self._queue.qsize()):
            yield self._queue.get()


def records_of(item: Item) -> list[Record]:
    """As they are written. Raises ValueError, TypeError, struct.error on a value that cannot be encoded."""
    match item:
        case CompletedTick():
            return tick_records(item)
        case LaserBytes():
            return [encode_laser_bytes(item)]
        case CanFrameItem():
            return [encode_can_frame(*item)]
        case EventsItem():
            return [encode_events(item.stamp_ns, item.events)]
