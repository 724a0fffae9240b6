"""How much faster than the drive a recorded run is replayed: from the file on disk to the last comparison."""

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from drivers.measurements import Scan, WheelCounts
from runtime.messages.records import tick_records
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RunWriter
from runtime.record.reader import RunReader
from runtime.replay.replay import replay
from runtime.settings.configuration import Configuration
from runtime.tick import CompletedTick, Tick, Timing
from slam.estimator import Estimator
from slam.pose import Pose2


def times_real_time(drive: Sequence[tuple[int, Scan, WheelCounts, Pose2]], configuration: Configuration) -> float:
    """Seconds of driving for each second of CPU time; drive: stamp, scan, wheels and true pose of each tick."""
    with tempfile.TemporaryDirectory(prefix="infant-bench-") as name:
        record(Path(name), drive, configuration)
        began_s = time.process_time()
        result = replay(RunReader(Path(name)), configuration, verify=True)
        spent_s = time.process_time() - began_s
    if not result.identical:
        raise AssertionError(f"a replay differs from the run it repeats: {result.difference}")
    return result.recording_s / spent_s


def record(folder: Path, drive: Sequence[tuple[int, Scan, WheelCounts, Pose2]], configuration: Configuration) -> None:
    """The run that a live rover would have left behind."""
    writer = RunWriter(folder / "run.mcap", RunHeader(configuration.text, "live").metadata)
    estimator = Estimator(configuration.slam, configuration.seed)
    for seq, (stamp_ns, scan, wheels, truth) in enumerate(drive):
        tick = Tick(seq, stamp_ns, scan, (wheels,))
        estimate = estimator.step(stamp_ns, scan, (wheels,))
        writer.add(
            tick_records(CompletedTick(tick, estimate, Timing(0, 0, {"step": 0}), estimator.state_hash(), truth))
        )
    writer.close()
