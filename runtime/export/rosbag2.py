"""A run as a rosbag2 folder: MCAP and metadata.yaml, in wall time, that plays, and stands in one tree of frames."""

from collections import Counter
from pathlib import Path
from typing import BinaryIO

from mcap.writer import CompressionType, Writer

from drivers.measurements import Scan
from runtime.atomic_write import atomic_write
from runtime.export.grid import GridOfRun
from runtime.export.metadata import LATCHED, SENSOR_DATA, STANDARD, Topic, metadata_yaml
from runtime.maps.grid_message import GRID, grid_bytes
from runtime.messages.definitions import TYPES, definition
from runtime.messages.recorded_tick import RecordedTick
from runtime.messages.ros import encode_events
from runtime.ros2.laser_scan import SCAN, first_ray_ns, scan_bytes
from runtime.ros2.markers import MARKERS, landmark_bytes
from runtime.ros2.odometry import ODOMETRY, OdometryTrack, odometry_bytes
from runtime.ros2.poses import (
    PATH,
    POSE,
    POSES,
    STAMPED,
    DrivenPath,
    particle_bytes,
    pose_bytes,
    stamped_bytes,
)
from runtime.ros2.transforms import TF, planar_transform, static_bytes, transform_bytes, transforms_bytes
from runtime.ros2.vehicle import Vehicle
from runtime.settings.configuration import Configuration
from slam.estimate import Estimate

CHUNK_BYTES = 1 << 20
SLOW_NS = 1_000_000_000  # particles
PATH_NS = 5_000_000_000
TOPICS = {
    "/scan": Topic(SCAN, SENSOR_DATA),
    "/pose": Topic(POSE, STANDARD),
    "/odom": Topic(ODOMETRY, STANDARD),
    "/tf": Topic(TF, STANDARD),
    "/tf_static": Topic(TF, LATCHED),
    "/map": Topic(GRID, LATCHED),
    "/path": Topic(PATH, STANDARD),
    "/landmarks": Topic(MARKERS, STANDARD),
    "/particles": Topic(POSES, STANDARD),
    "/truth": Topic(STAMPED, STANDARD),
    "/diagnostics": Topic(TYPES["/diagnostics"], STANDARD),
}


class Rosbag2:
    """Fills an empty folder; metadata.yaml comes last, so that no reader takes an unfinished one for whole.

    messages: how many, by topic. offset_ns: from the record's stamps to wall time.
    """

    def __init__(self, path: Path, configuration: Configuration, offset_ns: int, resolution_m: float | None) -> None:
        self._folder, self._offset_ns = path, offset_ns
        self._name = f"{path.name}_0.mcap"
        self._file: BinaryIO = (path / self._name).open("xb")
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2")
        self._channels: dict[str, int] = {}
        self._vehicle = Vehicle.of(configuration)
        self._track, self._path = OdometryTrack(self._vehicle.odometry), DrivenPath()
        self._grid = None if resolution_m is None else GridOfRun(configuration.slam, resolution_m)
        self._first_ns: int | None = None
        self._last_ns = 0
        self._due_ns = {"/particles": 0, "/path": 0}
        self.messages: Counter[str] = Counter()

    def add(self, recorded: RecordedTick, estimate: Estimate) -> None:
        """All messages of a tick."""
        wall_ns, tick = estimate.stamp_ns + self._offset_ns, recorded.tick
        if self._first_ns is None:
            self._put("/tf_static", wall_ns, static_bytes(wall_ns, self._vehicle))
        if isinstance(tick.scan, Scan):
            scan_ns = first_ray_ns(tick.scan) + self._offset_ns
            self._put("/scan", scan_ns, scan_bytes(tick.scan, self._offset_ns, self._vehicle), wall_ns)
        pose = estimate.map_from_body
        self._put("/tf", wall_ns, transform_bytes(wall_ns, pose, estimate.odom_from_body))
        self._put("/pose", wall_ns, pose_bytes(wall_ns, estimate))
        self._put("/odom", wall_ns, odometry_bytes(wall_ns, self._track.take(estimate)))
        if (truth := recorded.truth) is not None:
            self._put("/tf", wall_ns, transforms_bytes(planar_transform(wall_ns, "map", "truth", truth)))
            self._put("/truth", wall_ns, stamped_bytes(wall_ns, truth))
        if estimate.landmarks is not None:
            self._put("/landmarks", wall_ns, landmark_bytes(estimate.landmarks, wall_ns))
        if estimate.particles is not None and self._due("/particles", wall_ns, SLOW_NS):
            self._put("/particles", wall_ns, particle_bytes(wall_ns, estimate.particles))
        if tick.events:
            self._put("/diagnostics", wall_ns, encode_events(wall_ns, tick.events).data)
        self._path.add(wall_ns, pose)
        if self._due("/path", wall_ns, PATH_NS):
            self._put("/path", wall_ns, self._path.as_bytes(wall_ns))
        if self._grid is not None:
            self._grid.add(tick.scan, estimate)

    def finish(self) -> None:
        """The whole path, the map, the index, and what describes it all."""
        first_ns, last_ns = self._first_ns or 0, self._last_ns
        self._put("/path", last_ns, self._path.as_bytes(last_ns))
        grid = None if self._grid is None else self._grid.grid_map()
        if grid is not None:  # logged at the start: whoever plays the bag has the map from there on
            self._put("/map", first_ns, grid_bytes(grid, first_ns))
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.flush()
        text = metadata_yaml(self._name, TOPICS, self.messages, first_ns, last_ns)
        atomic_write(self._folder / "metadata.yaml", text)

    @property
    def has_part_of_map(self) -> bool:
        """Whether the grid would have become too large, and shows the drive only until then."""
        return self._grid is not None and self._grid.full

    def close(self) -> None:
        """Give the file back."""
        self._file.close()

    def _due(self, topic: str, wall_ns: int, period_ns: int) -> bool:
        if wall_ns < self._due_ns[topic]:
            return False
        self._due_ns[topic] = wall_ns + period_ns
        return True

    def _put(self, topic: str, stamp_ns: int, data: bytes, log_ns: int | None = None) -> None:
        """log_ns: when it came, which is what a player goes by; its stamp where None."""
        channel = self._channels.get(topic)
        if channel is None:
            name = TOPICS[topic].type_name
            schema = self._writer.register_schema(name, "ros2msg", definition(name).encode())
            qos = {"offered_qos_profiles": TOPICS[topic].qos.as_text}
            channel = self._writer.register_channel(topic, "cdr", schema, qos)
            self._channels[topic] = channel
        came_ns = max(0, stamp_ns if log_ns is None else log_ns)
        self._writer.add_message(channel, came_ns, data, max(0, stamp_ns))
        self._first_ns = came_ns if self._first_ns is None else min(self._first_ns, came_ns)
        self._last_ns = max(self._last_ns, came_ns)
        self.messages[topic] += 1
