"""Draws a run into review.rrd: a pure function of the records, so that it can be made again from run.mcap."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import rerun as rr

from drivers.measurements import FloatArray, Scan
from runtime.errors import StorageError
from runtime.messages.pipe import CARRIED, SEGMENT
from runtime.messages.tick import Record
from runtime.printable import printable
from runtime.record.folder import RunFolder
from runtime.review.columns import SIGMAS, ReviewColumns, mixed
from runtime.review.curves import draw_curves, draw_speed
from runtime.review.drawing_state import DrawingState, caption, draw_end, draw_end_styles, draw_start, first_place
from runtime.review.innovation import draw_association, draw_innovation, predicted_motion
from runtime.review.layout import (
    DOUBTED,
    SURE,
    TRUTH,
    draw_legend,
    draw_rover,
    draw_set_truth,
    draw_static,
    layout,
)
from runtime.review.ticks import AssembledTick, BeamPoints, Motion, TickAssembler
from runtime.review.truth import TruthTrack
from runtime.settings.review import ReviewSettings
from slam.estimate import Estimate, Quality
from slam.observations import BeamVerdict
from slam.pose import Pose2
from slam.settings.slam import MountSettings

TRACE_EVERY = 10  # ticks between the scans that stay and add up to a map
PIECE_TICKS = 10  # of a path: who looks at a time in between sees it end 1 s before the rover at most
BATCH_TICKS = 10  # ticks per write: 1 s, which a power cut loses ...
AFTERWARDS_TICKS = 300  # ... thirty times as many where nothing can be lost: fewer chunks, which cost most ...
LIVE_TICKS = 2  # ... 0.2 s for who looks on
TRACE_STEP = 3  # every third point of a scan: a wall stays a wall
FLUSH_S, FIRST_BYTES = 30.0, 256 * 1024  # rerun waits for ever where its first words find no room
QUALITY_LEVELS = {Quality.TRACKING: "INFO", Quality.UNCERTAIN: "WARN", Quality.LOST: "ERROR"}
PATHS = ("SLAM", "odometry", "truth")


class ReviewWriter:
    """Takes records in the order of writing and draws them. Memory stays flat; nothing is read back.

    mount: of the laser; facts: lines for the legend; track: what an imported data set knows. viewer_url: of a viewer
    that is drawn into, in place of a file; batch_ticks: that are written at a time.
    Raises StorageError when the file cannot be made.
    """

    def __init__(
        self,
        path: Path,
        settings: ReviewSettings,
        mount: MountSettings | None = None,
        facts: Mapping[str, str] | None = None,
        track: TruthTrack | None = None,
        viewer_url: str | None = None,
        batch_ticks: int = BATCH_TICKS,
    ) -> None:
        self._path, self._viewer_url = path, viewer_url
        self._batch_ticks = batch_ticks if viewer_url is None else LIVE_TICKS
        self._settings, self._mount = settings, mount or MountSettings()
        self._body_from_laser = self._mount.as_pose()
        self._assembler, self._beams = TickAssembler(), BeamPoints()
        self._state = DrawingState(with_truth=track is not None)
        self._track, self._track_drawn = track, 0
        self._paths: dict[str, list[tuple[float, float]]] = {name: [] for name in PATHS}
        self._facts = dict(facts or {})
        self._name = printable(self._facts.get("run", path.parent.name))
        self._recording = self._begin()
        self._columns = ReviewColumns(self._recording)

    def feed(self, record: Record) -> None:
        """One record of the run; topics that are not drawn are passed over, SEGMENT begins another file."""
        if record.topic == SEGMENT:
            self._rotate(int(record.data))
        elif record.topic == CARRIED:
            self._state = DrawingState.from_bytes(record.data)
        elif record.topic == "/raw/laser":
            offset_ms = self._state.clock.feed(record)
            if offset_ms is not None and self._state.start_ns is not None:
                self._columns.scalar("plots/clock/laser_ms", offset_ms)
        elif (assembled := self._assembler.feed(record)) is not None:
            self.draw(assembled)

    def close(self, has_ended: bool = True) -> None:
        """Draw what is left and say how the whole is best looked at. has_ended: the run, and not only this writer.

        Raises StorageError when the disk was full.
        """
        self._draw_last()
        if has_ended and self._state.before is not None:
            draw_end(self._columns, self._state, self._state.before.map_from_body)
        self._end()

    def tell(self, facts: Mapping[str, str]) -> None:
        """Further lines for legend and caption, known only now."""
        self._facts |= facts
        draw_legend(self._recording, self._facts, SIGMAS)

    def draw_before(self, path_m: FloatArray) -> None:
        """The way (n, 2) that a rover had driven when somebody began to look."""
        self._paths["SLAM"] += [(x_m, y_m) for x_m, y_m in path_m.tolist()]
        self._state.driven_m += float(np.hypot(*np.diff(path_m, axis=0).T).sum())

    def carried(self) -> bytes:
        """What another writer has to know to go on after a segment as this one would; it is fed as CARRIED."""
        return self._state.to_bytes()

    def _begin(self) -> rr.RecordingStream:
        """A new file; all files of a run have one identity, by which a viewer puts them together."""
        recording = rr.RecordingStream("infant", recording_id=f"infant-{self._name}")
        try:
            if self._viewer_url is not None:
                live = layout(self._state.extent, False, is_live=True)
                recording.connect_grpc(self._viewer_url, default_blueprint=live)
            else:  # the footer's manifest of all chunks stays in memory until the file is closed: 3 MB a minute
                self._path.write_bytes(bytes(FIRST_BYTES))
                recording.save(self._path, layout(self._state.extent, True), write_footer=True)
        except (RuntimeError, OSError) as error:
            raise StorageError(f"{self._path} cannot be written ({error}); give a writable folder") from error
        recording.send_recording_name(self._name or "run")
        draw_static(recording, self._body_from_laser)
        draw_legend(recording, self._facts, SIGMAS)
        draw_end_styles(recording)
        if self._track is not None:
            draw_set_truth(recording, self._track.landmarks_m)
        elif self._state.with_truth:
            draw_rover(recording, "map/truth", TRUTH)
        return recording

    def _end(self) -> None:
        self._flush()
        self._recording.send_blueprint(
            layout(
                self._state.extent,
                self._state.with_truth,
                caption(self._state, self._facts),
                self._viewer_url is not None,
            ),
            make_active=True,
            make_default=True,
        )
        try:
            self._recording.flush(timeout_sec=FLUSH_S)  # the only call that tells of a disk that refused
        except RuntimeError as error:
            raise StorageError(f"{self._path} is incomplete ({error}); free space and draw it again") from error
        finally:
            self._recording.disconnect()

    def _rotate(self, number: int) -> None:
        """Close the file under the number of its segment and go on in a new one."""
        self._draw_last()
        self._end()
        try:
            os.replace(self._path, self._path.with_name(RunFolder.closed_review_name(number)))
        except OSError as error:
            raise StorageError(f"{self._path} cannot be renamed ({error.strerror}); check the disk") from error
        self._recording = self._begin()
        self._columns = ReviewColumns(self._recording)

    def draw(self, assembled: AssembledTick) -> None:
        """One tick."""
        tick, estimate = assembled.tick, assembled.estimate
        if self._state.start_ns is None:
            self._state.start_ns = tick.stamp_ns
        self._columns.at(tick.stamp_ns - self._state.start_ns, tick.seq)
        self._draw_events(assembled)
        draw_curves(self._columns, assembled)
        if estimate is not None:
            motion = Motion.between(self._state.before, estimate)
            if self._state.before is None:
                draw_start(self._columns, self._state, first_place(self._paths["SLAM"], estimate.map_from_body))
            else:
                draw_speed(self._columns, self._state.before, estimate)
            self._state.measure(estimate, assembled.truth)
            self._draw_track(tick.stamp_ns)
            if self._state.before is not None:
                predicted = predicted_motion(self._state.before, estimate, motion)
                draw_innovation(self._columns, estimate, self._state.landmarks, predicted, self._body_from_laser)
            self._draw_poses(estimate, assembled.truth)
            if estimate.particles is not None:
                self._columns.points("map/particles", estimate.particles[:, :2])
            self._draw_landmarks(estimate)
            if isinstance(tick.scan, Scan):
                self._draw_scan(tick.scan, estimate, motion)
            if estimate.features is not None and estimate.matches is not None:
                draw_association(
                    self._columns,
                    estimate.features,
                    estimate.matches,
                    motion,
                    self._body_from_laser,
                    self._state.landmarks,
                )
            self._state.before = estimate
        self._state.drawn += 1
        if self._state.drawn % PIECE_TICKS == 0:
            self._lay_paths()
        if self._state.drawn % self._batch_ticks == 0:
            self._flush()

    def _draw_last(self) -> None:
        if (assembled := self._assembler.last()) is not None:
            self.draw(assembled)

    def _due(self, what: str, every: int) -> bool:
        """Whether this was last drawn `every` ticks ago or more; a tick without a scan only puts it off."""
        if self._state.drawn - self._state.last_drawn.get(what, -every) < every:
            return False
        self._state.last_drawn[what] = self._state.drawn
        return True

    def _draw_events(self, assembled: AssembledTick) -> None:
        for event in (*assembled.losses, *assembled.tick.events):
            elapsed_ns = max(0, event.stamp_ns - (self._state.start_ns or 0))
            text = f"{event.source} {event.kind}: {event.reason}"
            self._columns.text("events", text, event.severity.value.upper(), elapsed_ns)
            if event.kind == "mark":
                self._columns.scalar("plots/error/mark", 0.0)
        before, now = self._state.before, assembled.estimate
        if now is not None and (before is None or before.quality is not now.quality):
            elapsed_ns = assembled.tick.stamp_ns - (self._state.start_ns or 0)
            self._columns.text("events", f"pose quality: {now.quality}", QUALITY_LEVELS[now.quality], elapsed_ns)

    def _draw_poses(self, estimate: Estimate, truth: Pose2 | None) -> None:
        pose = estimate.map_from_body
        self._columns.pose("map/rover", pose)
        center_m = np.array(((pose.x_m, pose.y_m),))
        self._columns.ellipses("map/pose_covariance", center_m, estimate.covariance[None, :2, :2], None)
        self._paths["SLAM"].append((pose.x_m, pose.y_m))
        self._paths["odometry"].append((estimate.odom_from_body.x_m, estimate.odom_from_body.y_m))
        if truth is not None:
            if not self._state.with_truth:
                draw_rover(self._recording, "map/truth", TRUTH)
            self._state.with_truth = True
            self._columns.pose("map/truth", truth)
            self._paths["truth"].append((truth.x_m, truth.y_m))

    def _draw_track(self, until_ns: int) -> None:
        """The places of a data set's truth that have been passed by now, and the error there."""
        if self._track is None:
            return
        first, self._track_drawn = self._track_drawn, int(np.searchsorted(self._track.stamps_ns, until_ns, "right"))
        passed = slice(first, self._track_drawn)
        if first == self._track_drawn:
            return
        self._columns.points("map/truth_places", self._track.places_m[passed])
        self._columns.scalar("plots/error/SLAM_m", float(self._track.errors_m[passed][-1]))
        self._state.extent = self._state.extent.with_points(self._track.places_m[passed])

    def _draw_landmarks(self, estimate: Estimate) -> None:
        if (landmarks := estimate.landmarks) is None:
            return
        self._state.landmarks = landmarks
        sure = 1.0 / (1.0 + np.exp(-landmarks.existence_log_odds))
        colors = mixed(DOUBTED, SURE, sure)
        labels = [f"{name} ({p:.2f})" for name, p in zip(landmarks.identities.tolist(), sure.tolist(), strict=True)]
        self._columns.named_points("map/landmarks", landmarks.means_m, colors, labels)
        see_through = np.concatenate((colors, np.full((len(colors), 1), 60, np.uint8)), axis=1)
        self._columns.ellipses("map/landmarks/covariances", landmarks.means_m, landmarks.covariances_m2, see_through)
        self._state.extent = self._state.extent.with_points(landmarks.means_m)

    def _draw_scan(self, scan: Scan, estimate: Estimate, motion: Motion) -> None:
        """Each beam where the laser was when it was taken, in the colour of what the front end made of it."""
        if not self._due("scan", self._settings.scan_every):
            return
        beams, stamps_ns, laser_m = self._beams.of(self._mount.upright(scan))
        verdicts = estimate.beam_verdicts
        if verdicts is None or verdicts.size != scan.ranges_m.size:
            verdicts = np.full(scan.ranges_m.size, BeamVerdict.NOT_COMPARED, np.uint8)
        points_m, verdicts = motion.to_map(stamps_ns, laser_m, self._body_from_laser), verdicts[beams]
        self._columns.scan(points_m, verdicts)
        if self._due("trace", TRACE_EVERY):
            self._columns.points("map/laser/trace", points_m[verdicts == BeamVerdict.KEPT][::TRACE_STEP])

    def _flush(self) -> None:
        self._lay_paths()
        self._columns.flush()

    def _lay_paths(self) -> None:
        """One piece of each path, which begins where the last one ended."""
        for name, points in self._paths.items():
            if not points:
                continue
            piece_m = np.array(points)
            if name in self._state.path_ends_m:
                piece_m = np.concatenate((self._state.path_ends_m[name], piece_m))
            self._state.path_ends_m[name] = piece_m[-1:]
            self._state.extent = self._state.extent.with_points(piece_m)
            if len(piece_m) > 1:
                self._columns.strip(f"map/path/{name}", piece_m)
            points.clear()
