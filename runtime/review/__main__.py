"""The process that draws: records come in on standard input, review.rrd goes out."""

import contextlib
import json
import os
import sys
from pathlib import Path
from typing import IO

from runtime.errors import UsageError
from runtime.messages.pipe import CARRIED, read_frames
from runtime.optional_packages import leave_out, needs
from runtime.settings.review import ReviewSettings
from slam.settings.slam import MountSettings

NICENESS = 10


def draw_from(stream: IO[bytes], path: Path, what: str) -> None:
    """Draw what comes until the stream ends; `what` is JSON: settings, mount, facts of the run.

    Raises UsageError where rerun is absent, StorageError.
    """
    with needs("rerun", "the picture of a run"):
        from runtime.review.writer import ReviewWriter
    given = json.loads(what)
    writer = ReviewWriter(path, ReviewSettings(**given["settings"]), MountSettings(**given["mount"]), given["facts"])
    is_renewed = False
    for record in read_frames(stream):
        if record.topic == CARRIED and not record.data:
            is_renewed = True
        else:
            writer.feed(record)
    writer.close(has_ended=not is_renewed)
    if is_renewed:
        sys.stdout.buffer.write(writer.carried())
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    leave_out("pandas")
    with contextlib.suppress(OSError):  # a service manager may forbid it; the picture is drawn all the same
        os.nice(NICENESS)
    try:
        draw_from(sys.stdin.buffer, Path(sys.argv[1]), sys.argv[2])
    except UsageError as error:
        sys.exit(str(error))  # the loop's process tells it on
