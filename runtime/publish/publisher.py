"""The sink that tells the world where the rover is: a bounded queue and one thread between the loop and the network."""

import atexit
import queue
import time

import zenoh

from drivers.measurements import Event
from drivers.stoppable_thread import StoppableThread, told
from runtime.commands import CommandQueue
from runtime.health import Health
from runtime.publish.commands import declare_commands
from runtime.publish.messages import warm_up
from runtime.publish.session import open_rover_session, rover_config, short_reason
from runtime.publish.status import namesake_trouble
from runtime.publish.topics import RoverTopics
from runtime.ros2.vehicle import Vehicle
from runtime.service.thread_watch import Failures
from runtime.settings.publish import PublishSettings
from runtime.tick import CompletedTick, SinkHealth

QUEUE = 20  # ticks that may wait; when full the oldest goes: 2 s at 10 Hz
REOPEN_S = 5.0
CLOSE_S = 3.0
LEAVE_S = 12.0  # towards a peer that has stopped reading zenoh takes 10 s to say goodbye


class ZenohPublisher:
    """Publishes every tick over zenoh; the loop only puts a reference into a queue.

    wall_offset_ns: wall time minus monotonic time; taken now when None. Messages carry stamp + offset.
    configuration_text: what the query infant/<rover>/configuration answers. vehicle: for scan, odometry and TF.
    simulated: a rover that no other can be taken for. listening: where tools reach the session; None until it is open.
    Raises ConfigurationError when the settings name a file that cannot be used.
    """

    def __init__(
        self,
        settings: PublishSettings,
        rover: str,
        wall_offset_ns: int | None = None,
        configuration_text: str = "",
        vehicle: Vehicle | None = None,
        simulated: bool = False,
    ) -> None:
        self._settings = settings
        self._rover = rover
        self._wall_offset_ns = time.time_ns() - time.monotonic_ns() if wall_offset_ns is None else wall_offset_ns
        self._configuration_text = configuration_text
        self._vehicle = vehicle or Vehicle()
        self._simulated = simulated
        self._namesake = ""
        # a SimpleQueue is C: no lock that a preempted thread could hold while the loop waits for it
        self._queue: queue.SimpleQueue[CompletedTick | Health | None] = queue.SimpleQueue()
        self._dropped = 0
        self._trouble = ""
        self._health: Health | None = None
        self._commands = CommandQueue(time.monotonic_ns)
        self.listening: tuple[str, ...] | None = None
        self._session: zenoh.Session | None = None
        self._topics: RoverTopics | None = None  # once all of them are declared
        self._failures = Failures("publish", time.monotonic_ns)
        self._thread = StoppableThread("publish", self._run, failed=self._failures.note)
        if settings.enabled:
            rover_config(settings, rover, settings.listen)  # a file that cannot be used stops the start, not the thread
            warm_up()
            atexit.register(self._leave)
            self._thread.start()

    def put(self, completed: CompletedTick) -> None:
        """Queue one tick; when the network is slower than the loop the oldest tick goes."""
        if not self._settings.enabled:
            return
        if self._queue.qsize() >= QUEUE:
            try:
                self._queue.get_nowait()
                self._dropped += 1
            except queue.Empty:
                pass  # the thread took it between the two lines
        self._queue.put(completed)

    def drain_events(self) -> tuple[Event, ...]:
        """Commands that came over zenoh since the last call; none unless publish.commands is on."""
        return self._commands.drain_events()

    def note_health(self, health: Health) -> None:
        """Health that goes into the next status; one assignment."""
        self._health = health

    def announce(self, health: Health) -> None:
        """Say now that the run has entered a state before its first tick or after its last one."""
        self._health = health
        if self._settings.enabled:
            self._queue.put(health)

    def health(self) -> SinkHealth:
        """Ticks waiting and lost, and why there is no session if there is none."""
        troubles = filter(None, (self._failures.trouble, self._trouble, self._namesake))
        return SinkHealth(self._queue.qsize(), self._dropped, "; ".join(troubles))

    def close(self) -> None:
        """Send what is queued and leave; at most 3 s."""
        if not self._settings.enabled:
            return
        self._queue.put(None)
        self._thread.stop(CLOSE_S)
        if not self._thread.is_alive():
            atexit.unregister(self._leave)

    def _leave(self) -> None:
        """Close before the interpreter ends, whoever forgot to: a thread of zenoh's that then asks for it aborts."""
        self._queue.put(None)
        self._thread.stop(LEAVE_S)

    def _run(self) -> None:
        """Own the session from opening to closing. It outlives what is raised here: to lose the peers takes seconds."""
        is_over = False
        try:
            topics = self._topics or self._opened_topics()
            if topics is not None:
                self._serve(topics)
            is_over = True
        finally:
            if self._session is not None and (is_over or self._topics is None or self._thread.was_stopped):
                self._close_session(self._session)
                self._session = self._topics = None

    def _opened_topics(self) -> RoverTopics | None:
        """Topics on a new session, None where close() was called; one that cannot be opened is tried every 5 s."""
        if not self._simulated:  # desks may have many of one name
            endpoints = (*self._settings.connect, *self._settings.listen)
            self._namesake = namesake_trouble(self._rover, endpoints, self._settings.config_file)
        while True:
            try:
                self._session, listening = open_rover_session(self._settings, self._rover)
                break
            except zenoh.ZError as error:
                self._trouble = f"no zenoh session: {short_reason(error)}"
                if self._thread.wait(REOPEN_S):
                    return None
        self._trouble = ""
        topics = RoverTopics(
            self._session,
            self._settings,
            self._rover,
            self._wall_offset_ns,
            self._configuration_text,
            listening,
            self._vehicle,
        )
        if self._settings.commands:
            declare_commands(self._session, self._rover, self._commands)
        self._topics, self.listening = topics, listening
        return topics

    def _serve(self, topics: RoverTopics) -> None:
        """Send ticks until close() was called and the queue is empty."""
        while (item := self._queue.get()) is not None:
            try:
                if isinstance(item, Health):
                    topics.send_state(item)
                else:
                    topics.send(item, self._health)
                self._trouble = ""
            except Exception as error:  # noqa: BLE001 one message that cannot be sent costs that message, whatever it is
                self._dropped += 1
                what = f"state {item.state}" if isinstance(item, Health) else f"tick {item.tick.seq}"
                self._trouble = f"{what} not published: {error!r}"
                if not isinstance(error, zenoh.ZError):
                    self._failures.note(told(error))

    def _close_session(self, session: zenoh.Session) -> None:
        """Say goodbye; towards a peer that has stopped reading this takes zenoh's 10 s, which close() does not wait."""
        try:
            session.close()  # type: ignore[no-untyped-call]
        except zenoh.ZError as error:
            self._trouble = f"session not closed: {short_reason(error)}"
