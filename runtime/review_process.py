"""The review is drawn by a process of its own: rerun's threads and memory never meet the loop's.

The parent frames records onto the child's standard input; the child is `python -m runtime.review_process`.
A child that dies or stalls costs the picture, which can be made again, and nothing else.
"""

import contextlib
import json
import os
import queue
import signal
import struct
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from runtime.messages import Record
from runtime.review_moments import TOPICS
from runtime.review_settings import ReviewSettings
from runtime.tick import SinkHealth, Tick, Timing
from slam.estimate import Estimate
from slam.pose import Pose2

FRAME = struct.Struct("<HqI")  # bytes of the topic, stamp ns, bytes of the data
WRITE_S = 2.0
DRAW_S = 5.0
NICENESS = 10


class ReviewProcess:
    """Draws a run while it is recorded: `feed` is the recorder's tee, the Sink is there for its health.

    path: review.rrd; body_from_laser: the laser's mount. Neither feed nor put ever blocks or raises.
    """

    def __init__(
        self,
        path: Path,
        settings: ReviewSettings,
        body_from_laser: Pose2 | None = None,
        facts: dict[str, str] | None = None,
    ) -> None:
        mount = (body_from_laser or Pose2()).as_array().tolist()
        what = json.dumps({"settings": settings.model_dump(), "mount": mount, "facts": facts or {}})
        self._limit = settings.queue
        self._queue: queue.SimpleQueue[Record | None] = queue.SimpleQueue()
        self._dropped = 0
        self._trouble = ""
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the child
        self._child = subprocess.Popen(
            [sys.executable, "-m", "runtime.review_process", str(path), what],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._errors,
            env={**os.environ, "RUST_LOG": "error", "RERUN_ANALYTICS": "off"},
        )
        self._thread = threading.Thread(target=self._send, name="review", daemon=True)
        self._thread.start()

    def feed(self, record: Record) -> None:
        """One record, in the order of writing; dropped and counted when the child does not keep up."""
        if record.topic not in TOPICS:
            return
        if self._trouble or self._queue.qsize() >= self._limit:
            self._dropped += 1
        else:
            self._queue.put(record)

    def put(
        self,
        tick: Tick,
        estimate: Estimate,
        timing: Timing,
        state_hash: bytes,
        truth: Pose2 | None,
    ) -> None:
        """Nothing: what is drawn comes as records."""

    def health(self) -> SinkHealth:
        """Records waiting and lost, and why the child is gone if it is."""
        return SinkHealth(self._queue.qsize(), self._dropped, self._trouble)

    @property
    def pid(self) -> int:
        """Of the child."""
        return self._child.pid

    def close(self) -> None:
        """Let the child finish its file; at most 7 s, after which it is ended and the file lacks its last second."""
        self._queue.put(None)
        self._thread.join(WRITE_S)
        try:
            if self._child.wait(DRAW_S) and not self._trouble:
                self._trouble = f"review.rrd is not whole ({self._last_words()}); infant review makes it again"
        except subprocess.TimeoutExpired:
            self._trouble = "review.rrd was not finished in time; infant review makes it again"
            self._child.kill()
            self._child.wait()
            self._thread.join(WRITE_S)
        self._errors.close()

    def _send(self) -> None:
        """Write frames until close() or until the child is gone."""
        pipe = self._child.stdin
        assert pipe is not None
        try:
            while (record := self._queue.get()) is not None:
                write_frame(pipe, record)
                if self._queue.empty():
                    pipe.flush()
            pipe.close()
        except OSError:
            why = f"the drawing process has ended ({self._last_words()}); infant review makes the picture"
            self._trouble = self._trouble or why  # close() knows better when it has ended the child itself
            self._dropped += 1 + self._forget_waiting()

    def _forget_waiting(self) -> int:
        """Empty the queue that nobody serves any more; returns how many records that were."""
        forgotten = 0
        while not self._queue.empty():
            forgotten += self._queue.get() is not None
        return forgotten

    def _last_words(self) -> str:
        """The last line that the child wrote as an error."""
        code = self._child.wait()
        self._errors.seek(max(0, os.fstat(self._errors.fileno()).st_size - 2000))
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"exit code {code}"


def write_frame(pipe: IO[bytes], record: Record) -> None:
    """One record as bytes of a stream. Raises OSError when nobody reads."""
    topic = record.topic.encode()
    pipe.write(FRAME.pack(len(topic), record.stamp_ns, len(record.data)) + topic + record.data)


def read_frames(stream: IO[bytes]) -> Iterator[Record]:
    """Records until the stream ends; a frame that is cut off there is not one."""
    while len(head := stream.read(FRAME.size)) == FRAME.size:
        topic_length, stamp_ns, data_length = FRAME.unpack(head)
        body = stream.read(topic_length + data_length)
        if len(body) < topic_length + data_length:
            return
        yield Record(body[:topic_length].decode(), stamp_ns, body[topic_length:])


def draw_from(stream: IO[bytes], path: Path, what: str) -> None:
    """The child: draw what comes until the stream ends."""
    from runtime.review_writer import ReviewWriter  # here, so that the parent never imports rerun

    given = json.loads(what)
    writer = ReviewWriter(path, ReviewSettings(**given["settings"]), Pose2(*given["mount"]), given["facts"])
    for record in read_frames(stream):
        writer.feed(record)
    writer.close()


if __name__ == "__main__":
    # Ctrl-C goes to the whole group: the parent decides when the drawing ends, by closing the pipe
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError):  # a service manager may forbid it; the picture is drawn all the same
        os.nice(NICENESS)
    draw_from(sys.stdin.buffer, Path(sys.argv[1]), sys.argv[2])
