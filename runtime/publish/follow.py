"""What a tool hears of one rover: a bounded queue of messages, and word when the rover comes, also again."""

import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import zenoh

from runtime.commands import Command
from runtime.errors import SensorError
from runtime.publish.commands import Answer, answer_of, command_key, no_answer
from runtime.publish.find_rover import FoundRover
from runtime.publish.session import short_reason, tool_session

MOST_WAITING, MOST_WAITING_BYTES = 500, 32 << 20  # when a tool is slower than its rover the newest messages are lost
LARGEST_HEARD = 2 << 20  # bytes of one message: 50 000 landmarks have 1.2 MB; a list of poses takes 20 times that
ASK_S = 2.0


@dataclass(frozen=True, slots=True)
class Message:
    """One message: the last word of its key, and its bytes."""

    name: str
    data: bytes


class Follower:
    """Hears a rover on a session. Anyone may publish on its keys: who decodes has to expect anything."""

    def __init__(self, session: zenoh.Session, rover: str, names: Iterable[str]) -> None:
        self.session, self.rover = session, rover
        self._waiting: queue.Queue[Message] = queue.Queue(MOST_WAITING)
        self._waiting_bytes = 0
        self._counting = threading.Lock()
        self._came = threading.Event()
        self.is_there = False
        # indirect=True would start Python threads that hang or abort a process that ends without closing the session
        for name in names:
            heard = zenoh.handlers.Callback(self._into(name), indirect=False)
            session.declare_subscriber(f"infant/{rover}/{name}", heard)
        alive = zenoh.handlers.Callback(self._alive, indirect=False)
        session.liveliness().declare_subscriber(f"infant/{rover}/alive", alive, history=True)

    def next(self, timeout_s: float) -> Message | None:
        """The next message, None where none came in time."""
        try:
            message = self._waiting.get(timeout=timeout_s)
        except queue.Empty:
            return None
        with self._counting:
            self._waiting_bytes -= len(message.data)
        return message

    def has_come(self) -> bool:
        """Whether the rover has come since this was last asked: what it answered before may no longer hold."""
        came = self._came.is_set()
        self._came.clear()
        return came

    def ask(self, name: str, most_bytes: int = LARGEST_HEARD) -> bytes | None:
        """Its answer on a key, None where it gives none of so many bytes in time."""
        for reply in self.session.get(f"infant/{self.rover}/{name}", timeout=ASK_S):
            if reply.ok is not None and len(reply.ok.payload) <= most_bytes:
                return bytes(reply.ok.payload.to_bytes())
        return None

    def command(self, command: Command, reason: str, heard: Callable[[Answer], None]) -> None:
        """Ask the rover to do something and wait for nothing; heard: told once what it says, in a thread of zenoh."""
        key = command_key(self.rover, command)
        answers: list[Answer] = []

        def hear(reply: zenoh.Reply) -> None:
            said = reply.ok or reply.err
            if said is not None and (answer := answer_of(said.payload)) is not None:
                answers.append(answer)

        def end() -> None:
            heard(answers[0] if answers else Answer(False, no_answer(self.rover, key)))

        callback = zenoh.handlers.Callback(hear, end, indirect=False)
        self.session.get(key, callback, payload=reason.encode(), timeout=ASK_S)

    def _into(self, name: str) -> Callable[[zenoh.Sample], None]:
        def keep(sample: zenoh.Sample) -> None:
            size = len(sample.payload)
            if size > LARGEST_HEARD:
                return
            with self._counting:
                if self._waiting.full() or self._waiting_bytes + size > MOST_WAITING_BYTES:
                    return
                self._waiting.put_nowait(Message(name, sample.payload.to_bytes()))
                self._waiting_bytes += size

        return keep

    def _alive(self, sample: zenoh.Sample) -> None:
        self.is_there = sample.kind == zenoh.SampleKind.PUT
        if self.is_there:
            self._came.set()


@contextmanager
def following(rover: FoundRover, names: Iterable[str], config_file: str | None = None) -> Iterator[Follower]:
    """A session for as long as the tool runs; zenoh connects again by itself. Raises SensorError."""
    try:
        with tool_session(rover.endpoint, config_file) as session:
            yield Follower(session, rover.name, names)
    except zenoh.ZError as error:
        why = short_reason(error)
        raise SensorError(f"{rover.endpoint}: no connection ({why}); give --connect and --zenoh") from error
