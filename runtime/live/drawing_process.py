"""The review is drawn by a process of its own: rerun's threads and memory never meet the loop's.

The parent frames records onto the child's standard input; the child is `python -m runtime.review`.
A child that dies or stalls costs the picture, which can be made again, and nothing else.
"""

import contextlib
import json
import math
import os
import queue
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from drivers.stoppable_thread import told
from runtime.messages.pipe import CARRIED, DRAWN, SEGMENT, write_frame
from runtime.messages.tick import Record
from runtime.service.memory import resident_mb
from runtime.settings.review import ReviewSettings
from runtime.tick import CompletedTick, SinkHealth
from slam.settings.slam import MountSettings

QUEUE = 4000  # records that may wait for the drawing process; 40 s at 100 records/s
WRITE_S = 2.0
DRAW_S = 60.0  # for a child that gets on; beside busy processes it has a twentieth of a core and takes so long
STALLED_S = 5.0  # without any work done a child is dead or stopped, and not slow
RENEW_S = 20.0
RENEW_MB = 400.0  # the library holds on to 3.7 MB for each minute that it draws; a new child begins with 230


class ReviewProcess:
    """Draws a run while it is recorded: it observes the recorder, and is a Sink for its health.

    path: review.rrd; mount: of the laser. Neither feed nor put ever blocks or raises.
    """

    def __init__(
        self,
        path: Path,
        settings: ReviewSettings,
        mount: MountSettings | None = None,
        facts: dict[str, str] | None = None,
    ) -> None:
        given = {"settings": settings.model_dump(), "mount": (mount or MountSettings()).model_dump()}
        what = json.dumps(given | {"facts": facts or {}})
        self._limit = QUEUE
        self._queue: queue.SimpleQueue[Record | None] = queue.SimpleQueue()
        self._dropped = 0
        self._trouble = ""
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the child
        self._renewing = False
        self._path = path
        self._latest_s = math.inf  # of time.monotonic
        self._command = [sys.executable, "-W", "ignore", "-m", "runtime.review", str(path), what]
        self._child = self._begin()
        self._thread = threading.Thread(target=self._send, name="review", daemon=True)
        self._thread.start()

    def feed(self, record: Record) -> None:
        """One record, in the order of writing; dropped and counted when the child does not keep up."""
        if record.topic not in DRAWN and record.topic != SEGMENT:
            return
        if self._trouble or self._queue.qsize() >= self._limit:
            self._dropped += 1
        else:
            self._queue.put(record)

    def segment_closed(self, number: int, stamp_ns: int) -> None:
        """The picture is rotated with the segments of the record."""
        self.feed(Record(SEGMENT, stamp_ns, b"%d" % number))

    def put(self, completed: CompletedTick) -> None:
        """Nothing: what is drawn comes as records."""

    def health(self) -> SinkHealth:
        """Records waiting and lost, and why the child is gone if it is."""
        return SinkHealth(self._queue.qsize(), self._dropped, self._trouble)

    @property
    def pid(self) -> int:
        """Of the child."""
        return self._child.pid

    def finish_by(self, latest_s: float) -> None:
        """close() waits no longer than until this time of time.monotonic."""
        self._latest_s = latest_s

    def close(self) -> None:
        """Let the child finish its file while it gets on, at most a minute; else it is ended, and its file removed."""
        self._queue.put(None)
        self._thread.join(min(WRITE_S + (RENEW_S if self._renewing else 0.0), self._left_s()))
        if self._has_ended():
            if self._child.returncode and not self._trouble:
                self._trouble = f"review.rrd is incomplete ({self._last_words()}); infant review draws it again"
        else:
            self._trouble = "review.rrd was not finished in time; infant review draws it again"
            self._child.kill()
            self._child.wait()
            self._path.unlink(missing_ok=True)  # whoever looks for it gets a whole one, drawn again
        self._thread.join(WRITE_S)  # it ends with the child, and may have read the child's last words
        self._errors.close()
        if self._child.stdout is not None:
            self._child.stdout.close()

    def _has_ended(self) -> bool:
        """Wait for the child as long as it works: its processor time grows. False where it stalls or takes too long."""
        self._latest_s = min(time.monotonic() + DRAW_S, self._latest_s)
        while self._left_s() > 0.0:
            worked = processor_ticks(self._child.pid)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._child.wait(min(STALLED_S, self._left_s()))
                return True
            if processor_ticks(self._child.pid) == worked:
                return False
        return self._child.poll() is not None

    def _left_s(self) -> float:
        """Seconds in which close() may wait."""
        return max(0.0, self._latest_s - time.monotonic())

    def _begin(self) -> "subprocess.Popen[bytes]":
        return subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env={**os.environ, "RUST_LOG": "error", "RERUN_ANALYTICS": "off"},
            start_new_session=True,  # Ctrl-C is for the parent, which ends the drawing by closing the pipe
        )

    def _renew(self) -> None:
        """Let the child end after a segment, and another go on with what it knew. Raises OSError when it cannot."""
        self._renewing = True
        assert self._child.stdin is not None
        write_frame(self._child.stdin, Record(CARRIED, 0, b""))
        try:
            carried = self._child.communicate(timeout=RENEW_S)[0]  # closes its input, which ends it
        except subprocess.TimeoutExpired as error:
            self._child.kill()
            raise ChildProcessError(0, "it did not end") from error
        if self._child.returncode:
            raise ChildProcessError(self._child.returncode, "it ended with an error")
        self._child = self._begin()
        assert self._child.stdin is not None
        write_frame(self._child.stdin, Record(CARRIED, 0, carried))
        self._renewing = False

    def _send(self) -> None:
        """Write frames until close() or until the child is gone."""
        try:
            while (record := self._queue.get()) is not None:
                assert self._child.stdin is not None
                write_frame(self._child.stdin, record)
                if self._queue.empty():
                    self._child.stdin.flush()
                if record.topic == SEGMENT and resident_mb(self._child.pid) > RENEW_MB:
                    self._renew()
            assert self._child.stdin is not None
            self._child.stdin.close()
        except OSError:
            self._give_up(self._last_words())
        except BaseException as error:  # noqa: BLE001 a frame that was cut in two ends what the child understands
            self._child.kill()
            self._give_up(told(error))

    def _give_up(self, cause: str) -> None:
        """Nothing is drawn any more, and why."""
        why = f"the drawing process has ended ({cause}); infant review draws the picture again"
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


def processor_ticks(pid: int) -> int:
    """Processor time of a process and its threads, in clock ticks; 0 when it has ended."""
    try:
        after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0
    return int(after_name[11]) + int(after_name[12])  # utime and stime: fields 14 and 15 of the line
