"""Makes the picture of a run again from its record."""

import os
from collections.abc import Callable
from pathlib import Path

from runtime.messages.pipe import TOPICS
from runtime.record.folder import RunFolder
from runtime.record.reader import RunReader
from runtime.settings.configuration import load_configuration_text
from runtime.settings.review import ReviewSettings


def build_review(
    run: Path,
    out_rrd: Path,
    settings: ReviewSettings | None = None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Make review.rrd again from a run, as one file; the old ones stay until the new one is whole.

    progress is told the share that is done. Raises NotARunError, StorageError.
    """
    os.environ.setdefault("RUST_LOG", "error")  # rerun's own words are not for whoever asked for a picture
    from runtime.review.truth import truth_track
    from runtime.review.writer import ReviewWriter

    reader = RunReader(run)
    header = reader.header
    configuration = load_configuration_text(header.configuration_text, source=str(run))
    facts = {"run": reader.folder.path.name, "source": header.source, "created": header.created_utc} | {
        name: header.versions[name] for name in ("infant", "rerun-sdk") if name in header.versions
    }
    track = truth_track(reader)
    if track is not None:
        facts["truth"] = track.name
    unfinished = out_rrd.with_name(out_rrd.name + ".unfinished")
    writer = ReviewWriter(
        unfinished, settings or configuration.review, configuration.slam.mount.as_pose(), facts, track
    )
    try:
        for record in reader.records():
            if record.topic in TOPICS:
                writer.feed(record)
                if progress is not None and record.topic == "/tick":
                    progress(reader.read_fraction)
        writer.close()
        os.replace(unfinished, out_rrd)
        for part in RunFolder(out_rrd.parent).review_paths():
            if part != out_rrd:
                part.unlink()  # it is in the new one
    finally:
        unfinished.unlink(missing_ok=True)
