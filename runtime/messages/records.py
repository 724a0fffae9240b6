"""One tick and all that came of it as the records of a run, in the order in which they are written."""

import numpy as np

from drivers.measurements import Event, Scan
from runtime.messages.estimate import encode_estimate
from runtime.messages.ros import encode_can_frame, encode_events, encode_odometry, encode_pose, encode_scan
from runtime.messages.tick import (
    LaserBytes,
    Record,
    encode_defect,
    encode_laser_bytes,
    encode_state_hash,
    encode_tick,
    encode_timing,
    encode_truth,
)
from runtime.tick import CompletedTick, Tick, Timing
from slam.estimate import Estimate, Quality
from slam.pose import Pose2


def input_records(tick: Tick) -> list[Record]:
    """What came in: the scan stands before the tick that needs it."""
    records = [encode_scan(tick.scan)] if isinstance(tick.scan, Scan) else []
    records.append(encode_tick(tick))
    if tick.events:
        records.append(encode_events(tick.stamp_ns, tick.events))
    return records


def outcome_records(completed: CompletedTick) -> list[Record]:
    """What came of it."""
    tick, estimate = completed.tick, completed.estimate
    records = [
        encode_estimate(estimate),
        encode_pose(estimate),
        encode_odometry(estimate),
        encode_timing(tick.seq, tick.stamp_ns, completed.timing),
        encode_state_hash(tick.seq, tick.stamp_ns, completed.state_hash),
    ]
    if completed.truth is not None:
        records.append(encode_truth(estimate.stamp_ns, completed.truth))
    if completed.defect:
        records.append(encode_defect(tick.stamp_ns, completed.defect))
    return records


def tick_records(completed: CompletedTick) -> list[Record]:
    """Everything of one tick."""
    return input_records(completed.tick) + outcome_records(completed)


def warm_up() -> None:
    """Encode one of everything, so that no encoder is generated (50 ms) while the loop runs."""
    nowhere = Pose2()
    tick = Tick(0, 0, Scan(0, np.zeros(1, np.float32), np.zeros(1)), (), (Event(0, "", "", ""),))
    zero = np.zeros((3, 3))
    estimate = Estimate(0, nowhere, zero, nowhere, zero, nowhere, Quality.UNCERTAIN)
    tick_records(CompletedTick(tick, estimate, Timing(0, 0, {}), b"", nowhere, "none"))
    encode_laser_bytes(LaserBytes(0, False, b""))
    encode_can_frame(0, 0, 0, b"")
