"""What went over a rover's wires, as the same arrays that other sets come in: SCIP of a Hokuyo, frames of a CAN bus.

The bytes themselves go into the run as well, as a live rover records them. A capture holds one of the two sensors;
a folder may hold one of each, taken at the same time.
"""

import heapq
from array import array
from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.measurements import DriverError
from drivers.settings.encoders import EncoderSettings
from drivers.wheels.layouts.choose import wheel_decoder
from drivers.wheels.pair import WheelPair
from runtime.errors import DataSetError
from runtime.importers.archive import Archive
from runtime.importers.parsing.beams import padded_ranges
from runtime.importers.parsing.candump_lines import FRAME_BYTES, FrameColumns, OrderedFrames, candump_line
from runtime.importers.parsing.clock_steps import join_clock, step_sentences
from runtime.importers.parsing.left_out import LeftOut
from runtime.importers.parsing.scip_capture import chunks, read_capture
from runtime.importers.parsing.text_lines import TextLines
from runtime.messages.ros import encode_can_frame
from runtime.messages.tick import LaserBytes, Record, encode_laser_bytes

CUT = "the log was cut off in this line"
IDS_SHOWN = 6
MOST_CHANNELS = 16  # buses in one log
BENIGN = ("lost", "gap", "duplicate", "out_of_order")


def load_scip(source: Path) -> Archive:
    """A capture of the laser's replies. Raises DataSetError where it cannot be read."""
    try:
        capture = read_capture(source)
    except OSError as error:
        raise DataSetError(f"{source} cannot be read ({error.strerror}); check the path") from error
    left_out = LeftOut()
    for reason, count in capture.useless.items():
        left_out.add("scans", reason, source.name, count)
    if capture.torn:
        left_out.notes.append(f"the last {capture.torn} bytes of {source.name} are an incomplete message")
    if capture.is_cut:
        left_out.warnings.append(
            f"{source.name} holds more than fits into memory and is read up to its message {capture.messages}; split it"
        )
    if capture.is_guessed and capture.parameters is not None:
        left_out.warnings.append(
            f"{source.name} does not hold the laser's answer to PP; its steps are assumed to be those of a "
            f"{capture.parameters.model}"
        )
    meta = {"name": f"scip {source.name}"}
    if not capture.scans:
        left_out.warnings.append(f"{source.name} holds no scan: none of its {capture.messages} messages is one")
        return Archive(meta["name"], source, {}, meta, left_out, raw=partial(_laser_records, source))
    first = capture.scans[0]
    arrays: dict[str, NDArray[Any]] = {
        "scan_t": np.array([scan.stamp_ns for scan in capture.scans]) * 1e-9,
        "ranges": padded_ranges([scan.ranges_m for scan in capture.scans]),
        "scan_angle_min": np.array([scan.bearings_rad[0] for scan in capture.scans]),
        "scan_angle_increment": np.array([np.diff(scan.bearings_rad[:2]).sum() for scan in capture.scans]),
        "scan_beams": np.array([len(scan.ranges_m) for scan in capture.scans]),
    }
    told: dict[str, Any] = {**meta, "range_max": first.range_max_m, "time_increment": first.beam_period_s}
    return Archive(meta["name"], source, arrays, told, left_out, raw=partial(_laser_records, source))


def _laser_records(source: Path, start_ns: int) -> Iterator[Record]:
    """The bytes as /raw/laser, with stamps since the set's start."""
    for stamp_ns, data in chunks(source):
        yield encode_laser_bytes(LaserBytes(max(0, (stamp_ns or 0) - start_ns), False, data))


def load_candump(source: Path, settings: EncoderSettings) -> Archive:
    """A log of candump, read with the layout of the wheels that a configuration names. Raises DataSetError."""
    left_out = LeftOut()
    frames = _frames(source, settings, left_out)
    try:
        decoder = wheel_decoder(settings)
    except DriverError as error:
        raise DataSetError(str(error)) from error
    pair = WheelPair(settings, decoder)
    samples: list[array[Any]] = [array(kind) for kind in "qddBB"]
    for frame in frames:
        pair.feed(frame)
        for sample in pair.take():
            row = (sample.stamp_ns, sample.left, sample.right, sample.valid, sample.unbroken)
            for column, value in zip(samples, row, strict=True):
                column.append(value)
    _report(source, frames, pair, decoder.ids, left_out)
    meta = {"name": f"candump {source.name}"}
    arrays: dict[str, NDArray[Any]] = {}
    stamps_ns, left, right, valid, unbroken = (np.array(column) for column in samples)
    if len(stamps_ns):
        arrays = {
            "odom_t": stamps_ns * 1e-9,
            "odom_ticks": np.column_stack((left, right)),
            "odom_valid": valid.astype(np.bool_),
            "odom_unbroken": unbroken.astype(np.bool_),
        }
    return Archive(meta["name"], source, arrays, dict(meta), left_out, raw=partial(_can_records, frames))


def joined(laser: Archive, wheels: Archive, source: Path) -> Archive:
    """A capture of the laser and one of the bus as one set; both have stamps of one clock, which the import checks."""
    assert laser.raw is not None
    assert wheels.raw is not None
    captures = (laser.raw, wheels.raw)

    def raw(start_ns: int) -> Iterator[Record]:
        return heapq.merge(*(records(start_ns) for records in captures), key=lambda record: record.stamp_ns)

    laser.left_out.join(wheels.left_out)
    meta = {**laser.meta, "name": f"wires {source.name}"}
    return Archive(meta["name"], source, laser.arrays | wheels.arrays, meta, laser.left_out, raw=raw)


def _frames(source: Path, settings: EncoderSettings, left_out: LeftOut) -> OrderedFrames:
    """Frames of one bus in the order of their stamps, on one clock that never goes back."""
    frames = FrameColumns()
    channels: dict[str, int] = {}
    lines = TextLines(source)
    lengths: dict[int, int] = {}
    for number, line, is_whole in lines:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            seconds, channel, frame = candump_line(line)
            if len(channels) == MOST_CHANNELS and channel not in channels:
                raise ValueError(f"more than {MOST_CHANNELS} buses")
        except ValueError as error:
            reason = f"the line cannot be read ({error})" if is_whole else CUT
            left_out.add("frames", reason, f"{source.name}:{number}")
            continue
        if not is_whole and len(frame.data) < lengths.get(frame.arbitration_id, 0):
            left_out.add("frames", CUT, f"{source.name}:{number}")
            continue
        lengths[frame.arbitration_id] = len(frame.data)
        frames.add(seconds, channels.setdefault(channel, len(channels)), frame)
        lines.keep(FRAME_BYTES)
    if lines.damage:
        left_out.warnings.append(f"{source.name} is read up to its last complete line: {lines.damage}")
    if not len(frames):
        first = left_out.first()
        raise DataSetError(
            f"{source} holds no frame with a time{f'; {first}' if first else ''}; record it with candump -l"
        )
    channel_of = np.array(frames.channels)
    counts = np.bincount(channel_of)
    wanted = channels.get(settings.bus.channel, int(counts.argmax()))
    if len(channels) > 1:
        taken = list(channels)[wanted]
        left_out.notes.append(
            f"{taken} is read, out of {', '.join(sorted(channels))}; encoders.bus.channel names the bus"
        )
    clock = join_clock(frames.times_s)
    left_out.warnings += step_sentences(clock.steps, lambda row: f"frame {row + 1}: the clock")
    left_out.add("frames", "the stamp is far from its neighbours", source.name, int((~clock.good).sum()))
    order = np.argsort(clock.stamps_s, kind="stable")
    order = order[clock.good[order] & (channel_of[order] == wanted)]
    return OrderedFrames(frames, order, np.rint(clock.stamps_s[order] * 1e9).astype(np.int64))


def _report(source: Path, frames: OrderedFrames, pair: WheelPair, ids: tuple[int, ...], left_out: LeftOut) -> None:
    """Say what the frames told of the wheels."""
    if not pair.good_frames:
        there = [
            f"{number:03X}" for number, _ in Counter(frame.arbitration_id for frame in frames).most_common(IDS_SHOWN)
        ]
        left_out.warnings.append(
            f"none of the {len(frames)} frames of {source.name} holds a wheel's count: the layout expects "
            f"{', '.join(f'{number:03X}' for number in sorted(ids))}, the most frequent ids are "
            f"{', '.join(there)}; give the configuration whose [encoders.layout] describes this bus with "
            "--config"
        )
    left_out.used["frames"] = len(frames)
    for wheel in (pair.left, pair.right):
        left_out.used[f"frames of the {wheel.wheel} wheel"] = pair.good_frames // 2
        for reason, count in wheel.counters.items():
            if count and reason not in BENIGN:
                left_out.add(f"frames of the {wheel.wheel} wheel", reason, source.name, count)


def _can_records(frames: OrderedFrames, start_ns: int) -> Iterator[Record]:
    """The frames as /raw/can, with stamps since the set's start."""
    start_ns = start_ns or int(frames.stamps_ns[0])  # a log without a wheel sample has no other start
    for stamp_ns, identity, data, flags in frames:
        yield encode_can_frame(max(0, stamp_ns - start_ns), identity, flags, data)
