"""Everything a rover says under infant/<rover>/ and, if asked, on the keys of ROS 2."""

import time
from collections import deque
from collections.abc import Callable

import zenoh

from drivers.measurements import Scan
from runtime.health import Health
from runtime.messages.definitions import TYPES
from runtime.messages.map_json import json_bytes, landmark_json
from runtime.publish import messages, ros2_keys
from runtime.settings.publish import PublishSettings
from runtime.tick import CompletedTick
from slam.estimate import LandmarkMap

STATUS_HZ = 1.0  # status and health messages per second
SCAN_BEAM_STEP = 3  # every n-th beam of it; 3 leaves 361 of 1081
LANDMARKS_HZ = 1.0  # maps of landmarks per second; 0 sends none
JSON = "application/json"
ANSWERS_HZ = 100.0  # answers to questions on each key; the loop needs the interpreter too
RATE_WINDOW = 21  # ticks over which the rate in the status is taken: 2 s at 10 Hz


class Pace:
    """True at most `hz` times a second of the stamps it is asked with; never for 0 Hz."""

    def __init__(self, hz: float) -> None:
        self._period_ns = round(1e9 / hz) if hz > 0 else None
        self._next_ns: int | None = None

    def due(self, stamp_ns: int) -> bool:
        """Whether it is time; the grid is kept, so that 2 Hz out of 10 Hz are exactly 2 Hz."""
        if self._period_ns is None:
            return False
        if self._next_ns is None or stamp_ns >= self._next_ns + 10 * self._period_ns:
            self._next_ns = stamp_ns
        if stamp_ns < self._next_ns:
            return False
        self._next_ns += self._period_ns
        return True


class Allowance:
    """Lets `hz` things a second happen, whoever asks for them, and as many at once after a pause of a second."""

    def __init__(self, hz: float) -> None:
        self._hz = hz
        self._left = hz
        self._last_ns: int | None = None

    def take(self, now_ns: int) -> bool:
        """Whether one more may happen now."""
        if self._last_ns is not None:
            self._left = min(self._hz, self._left + (now_ns - self._last_ns) * 1e-9 * self._hz)
        self._last_ns = now_ns
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Topic:
    """One key with its publisher: each message carries its number and wall time as an attachment of 33 bytes."""

    def __init__(
        self, session: zenoh.Session, key: str, encoding: str, urgent: bool = False, token: str | None = None
    ) -> None:
        # DROP: a peer that has stopped reading costs its own messages, never our time
        self._publisher = session.declare_publisher(
            key,
            encoding=zenoh.Encoding(encoding),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME if urgent else zenoh.Priority.DATA_LOW,
            express=urgent,
        )
        self._token = session.liveliness().declare_token(token) if token is not None else None
        self._gid = ros2_keys.publisher_gid(key, str(session.zid()))
        self._seq = 0

    def send(self, payload: bytes, wall_ns: int) -> None:
        """Hand one message to zenoh."""
        self._publisher.put(payload, attachment=ros2_keys.attachment(self._seq, wall_ns, self._gid))
        self._seq += 1


class RoverTopics:
    """The topics of one rover on one session; used by the publishing thread alone, but for the queries.

    Keys: pose, odom, scan, landmarks, status, health, event; queries: pose, map, configuration, status;
    liveliness token: alive.
    """

    def __init__(
        self,
        session: zenoh.Session,
        settings: PublishSettings,
        rover: str,
        wall_offset_ns: int,
        configuration_text: str,
        listening: tuple[str, ...],
    ) -> None:
        self._session = session
        self._settings = settings
        self._rover = rover
        self._wall_offset_ns = wall_offset_ns
        self._listening = listening
        self._status = b""
        self._pose = b""
        self._landmarks: LandmarkMap | None = None
        self._landmarks_ns = 0
        self._latest: CompletedTick | None = None
        self._stamps_ns: deque[int] = deque(maxlen=RATE_WINDOW)
        self._scan_pace = Pace(settings.scan_hz)
        self._landmark_pace = Pace(LANDMARKS_HZ)
        self._status_pace = Pace(STATUS_HZ)
        self._pose_topic = self._topic("pose", _cdr(TYPES["/pose"]), urgent=True)
        self._odometry_topic = self._topic("odom", _cdr(TYPES["/odom"]), urgent=True)
        self._scan_topic = self._topic("scan", _cdr(TYPES["/scan"]))
        self._landmark_topic = self._topic("landmarks", _cdr(messages.MARKERS))
        self._status_topic = self._topic("status", JSON)
        self._health_topic = self._topic("health", _cdr(messages.DIAGNOSTICS))
        self._event_topic = self._topic("event", JSON)
        self._ros2_topics = self._declare_ros2() if settings.ros2 else ()
        self._answer("pose", _cdr(TYPES["/pose"]), lambda: self._pose)
        self._answer("status", JSON, lambda: self._status)
        self._answer("configuration", "application/toml", configuration_text.encode)
        self._answer("map", JSON, self._map_json)
        self._alive = session.liveliness().declare_token(self._key("alive"))

    def send(self, completed: CompletedTick, health: Health | None) -> None:
        """Everything that is due on this tick; the pose first."""
        estimate, wall_ns = completed.estimate, completed.estimate.stamp_ns + self._wall_offset_ns
        pose, odometry = messages.pose_bytes(estimate, wall_ns), messages.odometry_bytes(estimate, wall_ns)
        self._pose_topic.send(pose, wall_ns)
        self._odometry_topic.send(odometry, wall_ns)
        self._pose = pose
        if self._ros2_topics:
            payloads = (pose, odometry, messages.transform_bytes(estimate, wall_ns))
            for topic, payload in zip(self._ros2_topics, payloads, strict=True):
                topic.send(payload, wall_ns)
        for event in completed.tick.events:
            event_ns = event.stamp_ns + self._wall_offset_ns
            self._event_topic.send(messages.event_json(event, event_ns), event_ns)
        self._latest = completed
        self._send_picture(completed, wall_ns)
        self._stamps_ns.append(completed.tick.stamp_ns)
        if self._status_pace.due(completed.tick.stamp_ns):
            self._send_status(wall_ns, health)

    def _send_picture(self, completed: CompletedTick, wall_ns: int) -> None:
        """Scan and landmarks, thinned in time."""
        scan, landmarks = completed.tick.scan, completed.estimate.landmarks
        if landmarks is not None:
            self._landmarks, self._landmarks_ns = landmarks, wall_ns
            if self._landmark_pace.due(completed.tick.stamp_ns):
                self._landmark_topic.send(messages.landmark_bytes(landmarks, wall_ns), wall_ns)
        if isinstance(scan, Scan) and self._scan_pace.due(completed.tick.stamp_ns):
            scan_ns = scan.stamp_ns + self._wall_offset_ns
            self._scan_topic.send(messages.scan_bytes(scan, scan_ns, SCAN_BEAM_STEP), scan_ns)

    def send_state(self, health: Health) -> None:
        """A state that belongs to no tick: status and health at once, whatever their pace."""
        self._send_status(health.stamp_ns + self._wall_offset_ns, health)

    def _send_status(self, wall_ns: int, health: Health | None) -> None:
        span_ns = self._stamps_ns[-1] - self._stamps_ns[0] if self._stamps_ns else 0
        rate_hz = (len(self._stamps_ns) - 1) * 1e9 / span_ns if span_ns > 0 else 0.0
        status = messages.status_object(self._rover, wall_ns, self._latest, rate_hz, health)
        self._status = json_bytes({**status, "listening": list(self._listening)})
        self._status_topic.send(self._status, wall_ns)
        if health is not None:
            self._health_topic.send(messages.health_bytes(health, wall_ns), wall_ns)

    def _map_json(self) -> bytes:
        landmarks = self._landmarks
        return b"" if landmarks is None else landmark_json(landmarks, self._landmarks_ns)

    def _key(self, name: str) -> str:
        return f"infant/{self._rover}/{name}"

    def _topic(self, name: str, encoding: str, urgent: bool = False) -> Topic:
        return Topic(self._session, self._key(name), encoding, urgent)

    def _declare_ros2(self) -> tuple[Topic, ...]:
        """Pose, odometry and TF as the ROS 2 node /<rover>/infant publishes them."""
        domain, zid = self._settings.ros2_domain, str(self._session.zid())
        namespace = ros2_keys.ros_name(self._rover)
        self._node = self._session.liveliness().declare_token(ros2_keys.node_token(domain, zid, namespace))
        names = {f"/{namespace}/pose": TYPES["/pose"], f"/{namespace}/odom": TYPES["/odom"], "/tf": messages.TF}
        return tuple(
            Topic(
                self._session,
                ros2_keys.data_key(domain, name, type_name),
                _cdr(type_name),
                urgent=True,
                token=ros2_keys.publisher_token(domain, zid, namespace, entity, name, type_name),
            )
            for entity, (name, type_name) in enumerate(names.items(), start=1)
        )

    def _answer(self, name: str, encoding: str, content: Callable[[], bytes]) -> None:
        """Answer queries for a key with what is known now; nothing known yet, or too many asking, is no reply."""
        key = self._key(name)

        allowance = Allowance(ANSWERS_HZ)

        def reply(query: zenoh.Query) -> None:  # what comes with the question is not looked at
            with query:
                payload = content() if allowance.take(time.monotonic_ns()) else b""
                if payload:
                    query.reply(key, payload, encoding=zenoh.Encoding(encoding))

        # indirect=True would start Python threads that hang or abort a process that ends without closing the session
        self._session.declare_queryable(key, zenoh.handlers.Callback(reply, indirect=False))


def _cdr(type_name: str) -> str:
    return f"application/cdr;{type_name}"
