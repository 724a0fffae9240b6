"""Makes the picture of a run again from its record."""

import os
from collections.abc import Callable
from pathlib import Path

from runtime.atomic_write import replacement
from runtime.errors import StorageError
from runtime.messages.decoding import decoded
from runtime.messages.pipe import DRAWN
from runtime.optional_packages import needs
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
    verdict: str = "",
) -> None:
    """Make review.rrd again from a run, as one file; the old ones stay until the new one is whole.

    verdict: of the report, for the caption.
    progress gets the share that is done. Raises NotARunError, StorageError, UsageError (no rerun).
    """
    os.environ.setdefault("RUST_LOG", "error")  # rerun's own words are not for whoever asked for a picture
    with needs("rerun", "the picture of a run"):
        from runtime.review.truth import truth_track
        from runtime.review.writer import AFTERWARDS_TICKS, ReviewWriter

    reader = RunReader(run)
    header = reader.header
    configuration = load_configuration_text(header.configuration_text, source=str(run))
    facts = {"run": printable(reader.folder.path.name), "source": header.source, "created": header.created_utc} | {
        name: header.versions[name] for name in ("infant", "rerun-sdk") if name in header.versions
    }
    facts |= {"verdict": verdict} if verdict else {}
    track = truth_track(reader)
    if track is not None:
        facts["truth"] = track.name
    given = settings or configuration.review
    try:
        with replacement(out_rrd) as unfinished:
            writer = ReviewWriter(
                unfinished, given, configuration.slam.mount, facts, track, batch_ticks=AFTERWARDS_TICKS
            )
            for record in reader.records():
                if record.topic in DRAWN:
                    decoded(record, lambda _: writer.feed(record), reader.place)  # noqa: B023 called at once
                    if progress is not None and record.topic == "/tick":
                        progress(reader.read_fraction)
            writer.close()
        for part in RunFolder(out_rrd.parent).review_paths():
            if part != out_rrd:
                part.unlink()  # it is in the new one
    except OSError as error:
        raise StorageError(f"{out_rrd} cannot be written ({error.strerror}); free space or check the mount") from error
