"""Makes the picture of a run again from its record."""

import json
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from runtime.atomic_write import replacement
from runtime.errors import InfantError, StorageError
from runtime.messages.decoding import decoded
from runtime.messages.pipe import DRAWN
from runtime.optional_packages import leave_out, needs
from runtime.printable import printable
from runtime.record.folder import RunFolder
from runtime.record.reader import RunReader
from runtime.settings.configuration import load_configuration_text
from runtime.settings.review import ReviewSettings


def build_review(
    run: Path,
    out_rrd: Path,
    settings: ReviewSettings | None = None,
    progress: Callable[[float], None] | None = None,
    verdict: Callable[[], str] | None = None,
) -> None:
    """Make review.rrd again from a run, as one file; the old ones stay until the new one is whole.

    verdict: gives that of the report, for the caption; asked for when all else is drawn.
    progress gets the share that is done. Raises NotARunError, StorageError, UsageError (no rerun).
    """
    os.environ.setdefault("RUST_LOG", "off")  # rerun's own words are not for whoever asked for a picture
    with needs("rerun", "the picture of a run"):
        from runtime.review.truth import truth_track
        from runtime.review.writer import AFTERWARDS_TICKS, ReviewWriter

    reader = RunReader(run)
    header = reader.header
    configuration = load_configuration_text(header.configuration_text, source=str(run))
    facts = {"run": printable(reader.folder.path.name), "source": header.source, "created": header.created_utc} | {
        name: header.versions[name] for name in ("infant", "rerun-sdk") if name in header.versions
    }
    track = truth_track(reader)
    if track is not None:
        facts["truth"] = track.name
    given = settings or configuration.review
    try:
        with replacement(out_rrd) as unfinished:
            writer = ReviewWriter(
                unfinished, given, configuration.slam.mount, facts, track, batch_ticks=AFTERWARDS_TICKS
            )
            for record in reader.records(DRAWN):
                decoded(record, lambda _: writer.feed(record), reader.place)  # noqa: B023 called at once
                if progress is not None and record.topic == "/tick":
                    progress(reader.read_fraction)
            if verdict is not None:
                writer.tell({"verdict": verdict()})
            writer.close()
        for part in RunFolder(out_rrd.parent).review_paths():
            if part != out_rrd:
                part.unlink()  # it is in the new one
    except OSError as error:
        raise StorageError(f"{out_rrd} cannot be written ({error.strerror}); free space or check the mount") from error


ENDS_S = 10.0  # after which a process that was told to end is ended


@contextmanager
def drawn_meanwhile(run: Path, out_rrd: Path) -> Iterator[Callable[[str], None]]:
    """Make review.rrd again in a process of its own, which ends with the verdict that is given to what this yields.

    Where none is given, or something is raised inside, no picture is left. Raises what build_review does.
    """
    command = [sys.executable, "-W", "ignore", "-m", "runtime.review.rebuild", str(run), str(out_rrd)]
    with subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,  # Ctrl-C is for the parent, which then ends the child
    ) as process:

        def finish(verdict: str) -> None:
            told, _ = process.communicate(json.dumps(verdict).encode())  # says nothing where the process has ended
            if not told:
                code = process.returncode
                raise InfantError(f"the process that draws {out_rrd} ended with code {code}; draw it again")
            if (error := pickle.loads(told)) is not None:  # noqa: S301 of our own process
                raise error

        try:
            yield finish
        finally:
            assert process.stdin is not None
            with suppress(OSError):
                process.stdin.close()  # who waits for a verdict ends by that, who draws by the signal
            process.terminate()
            try:
                process.wait(ENDS_S)
            except subprocess.TimeoutExpired:  # a library waits for something that does not come
                process.kill()


def _draw(run: Path, out_rrd: Path, asked: IO[bytes]) -> InfantError | None:
    """The process: draws, waits for the verdict, and gives what went wrong. Raises EOFError where nobody waits."""
    has_to_end = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: has_to_end.set())  # raised anywhere it might be lost in a library

    def go_on(_share: float) -> None:
        if has_to_end.is_set():
            raise EOFError

    def verdict() -> str:
        if not (line := asked.read()):
            raise EOFError
        return str(json.loads(line))

    try:
        build_review(run, out_rrd, progress=go_on, verdict=verdict)
    except InfantError as error:
        return error
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)  # nothing is left to clean up; rerun's end would trace back
    return None


if __name__ == "__main__":
    leave_out("pandas")
    with suppress(EOFError):
        sys.stdout.buffer.write(pickle.dumps(_draw(Path(sys.argv[1]), Path(sys.argv[2]), sys.stdin.buffer)))
