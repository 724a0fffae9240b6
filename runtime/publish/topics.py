"""Everything a rover says under infant/<rover>/ and, if asked, on the keys of ROS 2."""

import time
from collections import deque
from collections.abc import Callable

import zenoh
import zenoh.ext

from drivers.measurements import Scan
from runtime.health import Health
from runtime.messages.map_json import json_bytes, landmark_json
from runtime.publish import messages, ros2_keys
from runtime.publish.pace import Allowance, Pace
from runtime.publish.status import host_name
from runtime.ros2.laser_scan import SCAN, first_ray_ns, scan_bytes
from runtime.ros2.markers import MARKERS, landmark_bytes
from runtime.ros2.odometry import ODOMETRY, OdometryTrack, odometry_bytes
from runtime.ros2.poses import PATH, POSE, POSES, DrivenPath, particle_bytes, pose_bytes
from runtime.ros2.transforms import TF, static_bytes, transform_bytes
from runtime.ros2.vehicle import Vehicle
from runtime.settings.publish import PublishSettings
from runtime.tick import CompletedTick
from slam.estimate import LandmarkMap

STATUS_HZ = 1.0  # status and health messages per second
SCAN_BEAM_STEP = 3  # every n-th beam of it; 3 leaves 361 of 1081
SLOW_HZ = 1.0  # landmarks, particles and path per second
JSON = "application/json"
ANSWERS_HZ = 100.0  # answers to questions on each key; the loop needs the interpreter too
RATE_WINDOW = 21  # ticks over which the rate in the status is taken: 2 s at 10 Hz

ROS2_TYPES = {
    "pose": POSE,
    "odom": ODOMETRY,
    "tf": TF,
    "scan": SCAN,
    "landmarks": MARKERS,
    "particles": POSES,
    "path": PATH,
    "diagnostics": messages.DIAGNOSTICS,
}
"""What the rover says on the keys of rmw_zenoh."""


def ros2_topic(namespace: str, name: str) -> str:
    """/<namespace>/<name>, but for the topics that all nodes of a system share."""
    return f"/{name}" if name in ("tf", "diagnostics") else f"/{namespace}/{name}"


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
        self._gid = ros2_keys.publisher_gid(token or f"{session.zid()}/{key}")
        self._seq = 0

    def send(self, payload: bytes, wall_ns: int) -> None:
        """Hand one message to zenoh."""
        self._seq += 1  # the first message is number 1, as those of rmw_zenoh are
        self._publisher.put(payload, attachment=ros2_keys.attachment(self._seq, wall_ns, self._gid))

    @property
    def is_wanted(self) -> bool:
        """Whether anyone subscribes: what is large or only for some is made only then."""
        return bool(self._publisher.matching_status.matching)  # type: ignore[attr-defined]  # the stub says bool


class LatchedTransforms:
    """/tf_static as rmw_zenoh has it: whoever subscribes later asks for the last message."""

    def __init__(self, session: zenoh.Session, domain: int, namespace: str, entity: int, humble: bool) -> None:
        zid, name, latched = str(session.zid()), "/tf_static", ros2_keys.QOS_LATCHED
        token = ros2_keys.publisher_token(domain, zid, namespace, entity, name, TF, humble, latched)
        self._gid = ros2_keys.publisher_gid(token)
        self._publisher = zenoh.ext.declare_advanced_publisher(
            session,
            ros2_keys.data_key(domain, name, TF, humble),
            encoding=zenoh.Encoding(_cdr(TF)),
            cache=zenoh.ext.CacheConfig(max_samples=1),
            publisher_detection=True,
        )
        self._token = session.liveliness().declare_token(token)

    def send(self, payload: bytes, wall_ns: int) -> None:
        """Hand over the one message."""
        self._publisher.put(payload, attachment=ros2_keys.attachment(1, wall_ns, self._gid))


class RoverTopics:
    """The topics of one rover on one session; used by the publishing thread alone, but for the queries.

    Keys: pose, odom, scan, landmarks, status, health, event, and, where somebody subscribes, tf, scan_full, particles,
    path; queries: pose, map, path, tf_static, configuration, status; liveliness token: alive.
    """

    def __init__(
        self,
        session: zenoh.Session,
        settings: PublishSettings,
        rover: str,
        wall_offset_ns: int,
        configuration_text: str,
        listening: tuple[str, ...],
        vehicle: Vehicle,
    ) -> None:
        self._session = session
        self._settings = settings
        self._rover = rover
        self._wall_offset_ns = wall_offset_ns
        self._listening = listening
        self._vehicle = vehicle
        self._track = OdometryTrack(vehicle.odometry)
        self._path = DrivenPath()
        self._status = b""
        self._pose = b""
        self._landmarks: LandmarkMap | None = None
        self._landmarks_ns = 0
        self._latest: CompletedTick | None = None
        self._stamps_ns: deque[int] = deque(maxlen=RATE_WINDOW)
        self._scan_pace = Pace(settings.scan_hz)
        self._landmark_pace = Pace(SLOW_HZ)
        self._slow_pace, self._particle_pace = Pace(SLOW_HZ), Pace(SLOW_HZ)
        self._status_pace = Pace(STATUS_HZ)
        self._pose_topic = self._topic("pose", _cdr(POSE), urgent=True)
        self._odometry_topic = self._topic("odom", _cdr(ODOMETRY), urgent=True)
        self._tf_topic = self._topic("tf", _cdr(TF), urgent=True)
        self._scan_topic = self._topic("scan", _cdr(SCAN))
        self._full_scan_topic = self._topic("scan_full", _cdr(SCAN))
        self._particle_topic = self._topic("particles", _cdr(POSES))
        self._path_topic = self._topic("path", _cdr(PATH))
        self._landmark_topic = self._topic("landmarks", _cdr(MARKERS))
        self._status_topic = self._topic("status", JSON)
        self._health_topic = self._topic("health", _cdr(messages.DIAGNOSTICS))
        self._event_topic = self._topic("event", JSON)
        self._ros2_topics = self._declare_ros2() if settings.ros2 else {}
        self._answer("pose", _cdr(POSE), lambda: self._pose)
        self._answer("status", JSON, lambda: self._status)
        self._answer("configuration", "application/toml", configuration_text.encode)
        self._answer("map", JSON, self._map_json)
        self._answer("path", _cdr(PATH), self._path_bytes)
        self._answer("tf_static", _cdr(TF), lambda: static_bytes(time.time_ns(), vehicle))
        self._alive = session.liveliness().declare_token(self._key("alive"))

    def send(self, completed: CompletedTick, health: Health | None) -> None:
        """Everything that is due on this tick; the pose first."""
        estimate, wall_ns = completed.estimate, completed.estimate.stamp_ns + self._wall_offset_ns
        pose = pose_bytes(wall_ns, estimate)
        odometry = odometry_bytes(wall_ns, self._track.take(estimate))
        self._pose_topic.send(pose, wall_ns)
        self._odometry_topic.send(odometry, wall_ns)
        self._pose = pose
        if self._ros2_topics or self._tf_topic.is_wanted:
            transforms = transform_bytes(wall_ns, estimate.map_from_body, estimate.odom_from_body)
            self._tf_topic.send(transforms, wall_ns)
            for name, payload in (("pose", pose), ("odom", odometry), ("tf", transforms)):
                self._to_ros2(name, payload, wall_ns)
        for event in completed.tick.events:
            event_ns = event.stamp_ns + self._wall_offset_ns
            self._event_topic.send(messages.event_json(event, event_ns), event_ns)
        self._latest = completed
        self._path.add(wall_ns, estimate.map_from_body)
        self._send_picture(completed, wall_ns)
        self._stamps_ns.append(completed.tick.stamp_ns)
        if self._status_pace.due(completed.tick.stamp_ns):
            self._send_status(wall_ns, health)

    def _send_picture(self, completed: CompletedTick, wall_ns: int) -> None:
        """Scan and landmarks, thinned in time; the whole scan, particles and path where somebody wants them."""
        scan, estimate, stamp_ns = completed.tick.scan, completed.estimate, completed.tick.stamp_ns
        if estimate.landmarks is not None:
            self._landmarks, self._landmarks_ns = estimate.landmarks, wall_ns
            if self._landmark_pace.due(stamp_ns):
                landmarks = landmark_bytes(estimate.landmarks, wall_ns)
                self._landmark_topic.send(landmarks, wall_ns)
                self._to_ros2("landmarks", landmarks, wall_ns)
        if isinstance(scan, Scan):
            scan_ns = first_ray_ns(scan) + self._wall_offset_ns
            if self._ros2_topics or self._full_scan_topic.is_wanted:
                whole = scan_bytes(scan, self._wall_offset_ns, self._vehicle)
                self._full_scan_topic.send(whole, scan_ns)
                self._to_ros2("scan", whole, scan_ns)
            if self._scan_pace.due(stamp_ns):
                self._scan_topic.send(scan_bytes(scan, self._wall_offset_ns, self._vehicle, SCAN_BEAM_STEP), scan_ns)
        if self._slow_pace.due(stamp_ns) and (self._ros2_topics or self._path_topic.is_wanted):
            path = self._path.as_bytes(wall_ns)
            self._path_topic.send(path, wall_ns)
            self._to_ros2("path", path, wall_ns)
        wanted = self._ros2_topics or self._particle_topic.is_wanted
        if estimate.particles is not None and self._particle_pace.due(stamp_ns) and wanted:
            particles = particle_bytes(wall_ns, estimate.particles)
            self._particle_topic.send(particles, wall_ns)
            self._to_ros2("particles", particles, wall_ns)

    def send_state(self, health: Health) -> None:
        """A state that belongs to no tick: status and health at once, whatever their pace."""
        self._send_status(health.stamp_ns + self._wall_offset_ns, health)

    def _send_status(self, wall_ns: int, health: Health | None) -> None:
        span_ns = self._stamps_ns[-1] - self._stamps_ns[0] if self._stamps_ns else 0
        rate_hz = (len(self._stamps_ns) - 1) * 1e9 / span_ns if span_ns > 0 else 0.0
        status = messages.status_object(self._rover, wall_ns, self._latest, rate_hz, health)
        where = {"listening": list(self._listening), "host": host_name(), "instance": str(self._session.zid())}
        self._status = json_bytes({**status, **where})
        self._status_topic.send(self._status, wall_ns)
        if health is not None:
            diagnostics = messages.health_bytes(health, wall_ns)
            self._health_topic.send(diagnostics, wall_ns)
            self._to_ros2("diagnostics", diagnostics, wall_ns)

    def _map_json(self) -> bytes:
        landmarks = self._landmarks
        return b"" if landmarks is None else landmark_json(landmarks, self._landmarks_ns)

    def _path_bytes(self) -> bytes:
        return self._path.as_bytes(time.time_ns()) if len(self._path) else b""

    def _key(self, name: str) -> str:
        return f"infant/{self._rover}/{name}"

    def _topic(self, name: str, encoding: str, urgent: bool = False) -> Topic:
        return Topic(self._session, self._key(name), encoding, urgent)

    def _declare_ros2(self) -> dict[str, Topic]:
        """What the ROS 2 node /<rover>/infant publishes."""
        domain, zid, humble = self._settings.ros2_domain, str(self._session.zid()), self._settings.ros2 == "humble"
        namespace = ros2_keys.ros_name(self._rover)
        self._node = self._session.liveliness().declare_token(ros2_keys.node_token(domain, zid, namespace))
        topics = {}
        for entity, (short, type_name) in enumerate(ROS2_TYPES.items(), start=1):
            name = ros2_topic(namespace, short)
            token = ros2_keys.publisher_token(domain, zid, namespace, entity, name, type_name, humble)
            key = ros2_keys.data_key(domain, name, type_name, humble)
            topics[short] = Topic(self._session, key, _cdr(type_name), short in ("pose", "odom", "tf"), token)
        self._tf_static = LatchedTransforms(self._session, domain, namespace, len(topics) + 1, humble)
        self._tf_static.send(static_bytes(time.time_ns(), self._vehicle), time.time_ns())
        return topics

    def _to_ros2(self, name: str, payload: bytes, wall_ns: int) -> None:
        if name in self._ros2_topics:
            self._ros2_topics[name].send(payload, wall_ns)

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
