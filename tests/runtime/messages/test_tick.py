"""Every message comes back as it went in."""

import dataclasses
import time
import warnings
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mcap_ros2._dynamic import generate_dynamic

from drivers.measurements import (
    Event,
    OdometryPose,
    Scan,
    ScanLike,
    Severity,
    Sightings,
    SpeedSteering,
    SpeedYawRate,
    WheelCounts,
    uniform_bearings,
)
from runtime.messages.definitions import TYPES, definition
from runtime.messages.estimate import decode_estimate, decode_poses, encode_estimate
from runtime.messages.records import input_records, tick_records
from runtime.messages.ros import decode_ranges_m, encode_can_frame, encode_odometry, encode_pose
from runtime.messages.tick import (
    Gap,
    LaserBytes,
    Record,
    decode_gap,
    decode_laser_bytes,
    decode_state_hash,
    decode_tick,
    decode_timing,
    decode_truth,
    encode_gap,
    encode_laser_bytes,
    encode_state_hash,
    encode_tick,
    encode_timing,
    encode_truth,
    exact_increment_rad,
)
from runtime.tick import CompletedTick, Tick
from slam.pose import Pose2
from tests.support.runtime.inverses import decode_can_frame
from tests.support.runtime.recorded_values import make_estimate, make_tick, make_timing, same_bits

stamps = st.integers(0, 2**31 * 10**9 - 1)  # what builtin_interfaces/Time can hold: 68 years of uptime
any_float = st.floats(width=64)
lengths = st.integers(0, 40)


def tick_again(tick: Tick) -> Tick:
    records = {record.topic: record.data for record in input_records(tick)}
    ranges_m = decode_ranges_m(records["/scan"]) if "/scan" in records else None
    return decode_tick(records["/tick"], ranges_m)


@st.composite
def scans(draw: st.DrawFn) -> Scan:
    beams = draw(lengths)
    ranges_m = draw(arrays(np.float32, beams, elements=st.floats(width=32)))
    if draw(st.booleans()):
        bearings_rad = uniform_bearings(draw(st.floats(-4, 4)), draw(st.floats(1e-6, 0.1)), beams)
    else:
        bearings_rad = np.sort(draw(arrays(np.float64, beams, elements=st.floats(-4, 4), unique=True)))
    period_s, range_max_m = draw(st.floats(-1, 1)), draw(st.floats(0, 1e6))
    return Scan(draw(stamps), ranges_m, bearings_rad, period_s, draw(st.integers(0, max(0, beams - 1))), range_max_m)


@st.composite
def sightings(draw: st.DrawFn) -> Sightings:
    count = draw(lengths)
    return Sightings(
        draw(stamps),
        draw(arrays(np.float64, count, elements=any_float)),
        draw(arrays(np.float64, count, elements=any_float)),
        draw(arrays(np.int64, count)),
    )


wheels = st.one_of(
    st.builds(WheelCounts, stamps, any_float, any_float, st.booleans()),
    st.builds(SpeedSteering, stamps, any_float, any_float),
    st.builds(SpeedYawRate, stamps, any_float, any_float),
    st.builds(OdometryPose, stamps, any_float, any_float, any_float),
)
words = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)
events = st.builds(Event, stamps, words, words, words, st.sampled_from(Severity))
ticks = st.builds(
    Tick,
    st.integers(0, 2**60),
    stamps,
    st.one_of(st.none(), scans(), sightings()),
    st.lists(wheels, max_size=8).map(tuple),
    st.lists(events, max_size=3).map(tuple),
)


@given(ticks)
def test_a_tick_comes_back_to_the_last_bit(tick: Tick) -> None:
    assert same_bits(tick, tick_again(tick))


def test_arrays_of_a_tick_stand_in_memory_as_those_of_a_driver_do() -> None:
    rng = np.random.default_rng(3)
    for seen in ("scan", "sightings"):
        again = tick_again(make_tick(1, rng, seen)).scan
        assert again is not None
        for array in (again.ranges_m, again.bearings_rad):
            assert array.flags.aligned
            assert array.flags.owndata


def test_millimetres_survive() -> None:
    millimetres = np.arange(0, 65_000, 7)
    ranges_m = (millimetres / 1000.0).astype(np.float32)
    scan: ScanLike | None = Scan(0, ranges_m, np.linspace(-1, 1, ranges_m.size))
    scan = tick_again(Tick(0, 0, scan, ())).scan
    assert isinstance(scan, Scan)
    assert np.array_equal(np.round(scan.ranges_m * 1000.0), millimetres)


@given(st.floats(1.5, 6.3), st.integers(20, 3000))
def test_equally_spaced_bearings_need_two_numbers(view_rad: float, beams: int) -> None:
    assert exact_increment_rad(uniform_bearings(-view_rad / 2, view_rad / beams, beams)) is not None


def test_a_tick_without_its_scan_is_refused() -> None:
    tick = make_tick(3, np.random.default_rng(1))
    with pytest.raises(ValueError, match="tick 3 used a scan"):
        decode_tick(encode_tick(tick).data)


def test_the_pose_of_an_estimate_comes_back_to_the_last_bit() -> None:
    estimate = make_estimate(5, np.random.default_rng(2))
    record = encode_estimate(estimate)
    again = decode_estimate(record.data)
    for name in ("stamp_ns", "map_from_body", "covariance", "particle_mean", "particle_covariance", "odom_from_body"):
        assert same_bits(getattr(estimate, name), getattr(again, name)), name
    poses = (estimate.map_from_body, estimate.particle_mean, estimate.odom_from_body)
    assert decode_poses(record.data) == (poses, estimate.counts)
    assert again.quality is estimate.quality
    assert again.counts == estimate.counts


def test_what_a_reviewer_sees_comes_back_as_float32() -> None:
    estimate = make_estimate(5, np.random.default_rng(2))
    again = decode_estimate(encode_estimate(estimate).data)
    features, landmarks = again.features, again.landmarks
    assert features
    assert landmarks
    for name in ("ranges_m", "bearings_rad", "covariances", "may_create", "identities", "beams"):
        np.testing.assert_allclose(getattr(features, name), getattr(estimate.features, name), rtol=1e-6)
    for name in ("identities", "means_m", "covariances_m2", "existence_log_odds"):
        np.testing.assert_allclose(getattr(landmarks, name), getattr(estimate.landmarks, name), rtol=1e-6)
    for name in ("particles", "particle_weights", "matches", "beam_verdicts"):
        np.testing.assert_allclose(getattr(again, name), getattr(estimate, name), rtol=1e-6)


def test_an_estimate_with_numbers_that_are_none_is_decoded_without_a_warning() -> None:
    """A signalling NaN in the bytes of a foreign record warned when it was made wider."""
    signalling: Any = np.array((0x7F800001,) * 3, np.uint32).view(np.float32)
    estimate = make_estimate(1, np.random.default_rng(4))
    data = encode_estimate(dataclasses.replace(estimate, particles=signalling[None])).data
    assert signalling.tobytes() in data
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        particles = decode_estimate(data).particles
    assert particles is not None
    assert np.isnan(particles).all()


def test_an_estimate_without_a_scan_has_none_of_the_scan() -> None:
    full = make_estimate(5, np.random.default_rng(2))
    names = ("particles", "particle_weights", "features", "matches", "beam_verdicts", "landmarks")
    nothing: dict[str, Any] = dict.fromkeys(names)
    again = decode_estimate(encode_estimate(dataclasses.replace(full, **nothing, counts={})).data)
    assert [getattr(again, name) for name in nothing] == [None] * len(nothing)
    assert again.counts == {}


def test_the_small_messages_come_back() -> None:
    timing = make_timing(3)
    assert decode_timing(encode_timing(3, 30, timing).data) == timing
    assert decode_state_hash(encode_state_hash(3, 30, bytes(range(16))).data) == bytes(range(16))
    assert decode_truth(encode_truth(3, Pose2(0.1, -0.2, 0.3)).data) == Pose2(0.1, -0.2, 0.3)
    assert decode_gap(encode_gap(Gap(1, 2, 3, "disk full")).data) == Gap(1, 2, 3, "disk full")
    raw = LaserBytes(7, True, b"MD0000108001000\n")
    assert decode_laser_bytes(encode_laser_bytes(raw).data) == raw


@given(stamps, st.integers(0, 2**29 - 1), st.integers(0, 7), st.binary(max_size=8))
def test_a_can_frame_comes_back(stamp_ns: int, arbitration_id: int, flags: int, data: bytes) -> None:
    record = encode_can_frame(stamp_ns, arbitration_id, flags, data)
    assert decode_can_frame(record.topic, record.data) == (stamp_ns, arbitration_id, flags, data)


def test_an_fd_frame_keeps_all_its_bytes() -> None:
    record = encode_can_frame(5, 0x181, 8 | 1, bytes(range(64)))
    assert record.topic == "/raw/can_fd"
    assert decode_can_frame(record.topic, record.data) == (5, 0x181, 9, bytes(range(64)))


@pytest.mark.parametrize("topic", sorted(TYPES))
def test_another_reader_understands_every_type(topic: str) -> None:
    rng = np.random.default_rng(4)
    tick, estimate = make_tick(7, rng), make_estimate(70, rng)
    completed = CompletedTick(tick, estimate, make_timing(7), bytes(16), Pose2(1.0, 2.0, 0.5), "why")
    records = {r.topic: r for r in tick_records(completed)}
    for record in (
        encode_can_frame(1, 2, 0, b"abc"),
        encode_can_frame(1, 2, 8, b"abc"),
        encode_gap(Gap(1, 2, 3, "x")),
        encode_laser_bytes(LaserBytes(1, False, b"abc")),
    ):
        records[record.topic] = record
    decoder = generate_dynamic(TYPES[topic], definition(TYPES[topic]))[TYPES[topic]]
    assert decoder(records[topic].data) is not None


def test_another_reader_sees_the_pose_where_it_is() -> None:
    estimate = make_estimate(1_500_000_000, np.random.default_rng(5))
    name = "geometry_msgs/msg/PoseWithCovarianceStamped"
    message = generate_dynamic(name, definition(name))[name](encode_pose(estimate).data)
    assert message.header.frame_id == "map"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
    assert message.pose.pose.position.x == estimate.map_from_body.x_m
    assert message.pose.covariance[35] == estimate.covariance[2, 2]
    heading_rad = 2 * np.arctan2(message.pose.pose.orientation.z, message.pose.pose.orientation.w)
    assert heading_rad == pytest.approx(estimate.map_from_body.heading_rad)


def test_a_record_claims_nothing_of_its_odometry() -> None:
    name = "nav_msgs/msg/Odometry"
    record: Record = encode_odometry(make_estimate(1, np.random.default_rng(5)))
    message = generate_dynamic(name, definition(name))[name](record.data)
    assert message.pose.covariance[0] == message.twist.covariance[35] == 1e6  # a minus one is taken for a variance


@pytest.mark.bench
def test_decoding_a_tick_takes_less_than_three_tenths_of_a_millisecond() -> None:
    records = {r.topic: r.data for r in input_records(make_tick(1, np.random.default_rng(1)))}
    began_s = time.process_time()
    for _ in range(1000):
        decode_tick(records["/tick"], decode_ranges_m(records["/scan"]))
    assert (time.process_time() - began_s) / 1000 < 0.3e-3
