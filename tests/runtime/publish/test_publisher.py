"""The pose reaches other processes, and nothing that the network does reaches the loop."""

import json
import os
import signal

import numpy as np
import pytest
import zenoh
from zenoh.handlers import FifoChannel

from runtime.errors import ConfigurationError
from runtime.health import Health, RunState
from runtime.publish.pace import Pace
from runtime.publish.publisher import ZenohPublisher
from runtime.publish.session import next_port, rover_config, tool_config
from runtime.settings.publish import PublishSettings
from runtime.tick import CompletedTick, SinkHealth
from slam.estimate import Quality
from tests.support.drivers.raising import raise_in
from tests.support.runtime.inverses import read_attachment
from tests.support.runtime.recorded_values import make_estimate, make_tick, make_timing
from tests.support.runtime.ros_types import (
    Odometry,
    PoseWithCovarianceStamped,
    read,
)
from tests.support.zenoh.router import start_router, stop_router
from tests.support.zenoh.wire import (
    WALL_OFFSET_NS,
    free_port,
    listening,
    opened,
    publishing,
    put_ticks,
    settings_on,
    until,
)

TICK_NS = 100_000_000


def test_a_subscriber_in_another_process_receives_every_pose_once_and_in_order() -> None:
    port = free_port()
    with publishing(settings_on(port)) as publisher, listening(f"tcp/127.0.0.1:{port}", "infant/r1/pose") as listener:
        put_ticks(publisher, range(5), 0.02)  # until the subscription has arrived
        assert until(lambda: len(listener.messages) > 0)
        put_ticks(publisher, range(100, 120), 0.02)
        assert until(lambda: read_attachment(bytes.fromhex(listener.messages[-1]["attachment"]))[1] == stamp_of(119))
        messages = listener.messages[-20:]
    sequence = [read_attachment(bytes.fromhex(message["attachment"]))[0] for message in messages]
    assert sequence == list(range(sequence[0], sequence[0] + 20)), "a pose was lost or doubled"
    assert messages[0]["encoding"] == "application/cdr;geometry_msgs/msg/PoseWithCovarianceStamped"


URGENT = ("pose", "odom", "tf")


def test_what_is_urgent_of_some_ticks_may_wait_for_a_busy_sender_and_is_not_dropped() -> None:
    config = rover_config(settings_on(free_port()), "r1", ())
    places = json.loads(config.get_json("transport/link/tx/queue/size/real_time"))
    assert places >= 5 * len(URGENT)  # each takes one: with zenoh's 2, 70 of 1272 were lost beside four busy processes


def stamp_of(seq: int) -> int:
    return seq * TICK_NS + WALL_OFFSET_NS


def test_a_reader_nobody_here_wrote_reads_every_message() -> None:
    port, rng = free_port(), np.random.default_rng(3)
    tick, estimate = make_tick(7, rng), make_estimate(7 * TICK_NS, rng)
    wanted = {"infant/r1/pose", "infant/r1/odom"}
    with publishing(settings_on(port)) as publisher, listening(f"tcp/127.0.0.1:{port}", "infant/**") as listener:
        for _ in range(200):
            publisher.put(CompletedTick(tick, estimate, make_timing(7), bytes(16), None))
            if until(lambda: {message["key"] for message in listener.messages} >= wanted, 0.05):
                break
    pose = read(PoseWithCovarianceStamped, listener.payloads("infant/r1/pose")[0])
    assert (pose.pose.pose.position.x, pose.pose.pose.position.y) == (
        estimate.map_from_body.x_m,
        estimate.map_from_body.y_m,
    )
    assert pose.header.frame_id == "map"
    assert pose.header.stamp.sec * 10**9 + pose.header.stamp.nanosec == stamp_of(7)
    assert pose.pose.covariance[35] == estimate.covariance[2, 2]
    odometry = read(Odometry, listener.payloads("infant/r1/odom")[0])
    assert odometry.pose.pose.position.x == estimate.odom_from_body.x_m
    assert odometry.pose.covariance[0] >= 0.0
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")


def test_queries_answer_with_the_last_pose_map_status_and_configuration() -> None:
    port = free_port()
    with publishing(settings_on(port), configuration_text='rover = "r1"\n') as publisher:
        assert opened(publisher)
        publisher.note_health(Health(0, RunState.DEGRADED, ("laser stale",), {}, {"x": SinkHealth(1, 2)}, Quality.LOST))
        put_ticks(publisher, range(3), 0.0)
        answers: dict[str, bytes] = {}
        with zenoh.open(tool_config(f"tcp/127.0.0.1:{port}")) as session:

            def complete() -> bool:
                for reply in session.get("infant/r1/*", timeout=1.0):
                    if reply.ok is not None:
                        answers[str(reply.ok.key_expr)] = reply.ok.payload.to_bytes()
                return len(answers) == 6

            assert until(complete), sorted(answers)
            alive = [str(reply.ok.key_expr) for reply in session.liveliness().get("infant/*/alive") if reply.ok]
    assert alive == ["infant/r1/alive"]
    assert answers["infant/r1/configuration"] == b'rover = "r1"\n'
    assert json.loads(answers["infant/r1/map"])["identities"] == [4096, 8193]
    status = json.loads(answers["infant/r1/status"])
    assert (status["state"], status["reasons"]) == ("degraded", ["laser stale"])
    assert read(PoseWithCovarianceStamped, answers["infant/r1/pose"]).header.frame_id == "map"


def test_a_taken_port_moves_the_second_rover_to_the_next() -> None:
    port = free_port()
    with publishing(settings_on(port), "r1") as first:
        assert opened(first) == (f"tcp/127.0.0.1:{port}",)
        with publishing(settings_on(port), "r2") as second:
            moved = opened(second)
            assert moved
            assert moved != (f"tcp/127.0.0.1:{port}",)
            assert second.health().trouble == ""


@pytest.mark.bench
def test_put_costs_the_loop_microseconds_while_a_subscriber_listens() -> None:
    port = free_port()
    with publishing(settings_on(port)) as publisher, listening(f"tcp/127.0.0.1:{port}", "infant/**"):
        costs_s = put_ticks(publisher, range(100), 0.005)
    assert np.percentile(costs_s, 50) < 50e-6


def test_a_stalled_subscriber_blocks_neither_put_nor_close() -> None:
    port = free_port()
    with publishing(settings_on(port)) as publisher, listening(f"tcp/127.0.0.1:{port}", "infant/**") as listener:
        assert until(lambda: bool(put_ticks(publisher, range(1), 0.0)) and len(listener.messages) > 0)
        os.kill(listener.process.pid, signal.SIGSTOP)
        put_ticks(publisher, range(400), 0.002)
        publisher.close()
        assert listener.process.poll() is None, "it stood still all the time, and nobody waited for it"


def test_a_killed_router_costs_put_nothing_and_is_found_again() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = start_router(endpoint)
    try:
        settings = settings_on(free_port(), connect=(endpoint,))
        with publishing(settings) as publisher, listening(endpoint, "infant/**") as listener:
            assert until(lambda: bool(put_ticks(publisher, range(1), 0.0)) and len(listener.messages) > 0)
            stop_router(router)
            put_ticks(publisher, range(100), 0.01)
            router = start_router(endpoint)
            heard = len(listener.messages)
            assert until(lambda: bool(put_ticks(publisher, range(1), 0.0)) and len(listener.messages) > heard)
    finally:
        stop_router(router)


def test_a_full_queue_loses_the_oldest_tick_and_counts_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("runtime.publish.publisher.QUEUE", 5)
    settings = settings_on(free_port(), connect=("tls/127.0.0.1:1",), config_file=None)
    publisher = ZenohPublisher(settings.model_copy(update={"enabled": False}), "r1")
    publisher._settings = settings  # the thread never starts, as if the network hung for ever
    put_ticks(publisher, range(12), 0.0)
    assert (publisher.health().depth, publisher.health().dropped) == (5, 7)
    first = publisher._queue.get_nowait()
    assert isinstance(first, CompletedTick)
    assert first.tick.seq == 7


def test_a_session_that_cannot_open_is_a_state_and_is_tried_again() -> None:
    settings = PublishSettings(connect=(), listen=("tcp/203.0.113.7:7448",))  # an address that no machine here has
    with publishing(settings) as publisher:
        assert until(lambda: "no zenoh session" in publisher.health().trouble)
        put_ticks(publisher, range(2), 0.0)
    assert until(lambda: not publisher._thread.is_alive())


def test_a_missing_zenoh_file_stops_the_start_with_its_name() -> None:
    with pytest.raises(ConfigurationError, match=r"publish.config_file = 'nowhere.json5': no such file"):
        ZenohPublisher(PublishSettings(config_file="nowhere.json5"), "r1")


def test_a_disabled_publisher_does_nothing() -> None:
    with publishing(PublishSettings(enabled=False)) as publisher:
        put_ticks(publisher, range(3), 0.0)
        assert publisher.health() == SinkHealth(0, 0)


def test_a_pace_keeps_its_rate_out_of_any_tick_rate() -> None:
    pace = Pace(2.0)
    assert sum(pace.due(seq * TICK_NS) for seq in range(100)) == 20
    assert not Pace(0.0).due(0)


@pytest.mark.parametrize(
    ("endpoint", "following"),
    [("tcp/127.0.0.1:7448", "tcp/127.0.0.1:7449"), ("tcp/[::1]:7448#iface=lo", "tcp/[::1]:7449#iface=lo")],
)
def test_the_next_port_leaves_the_rest_of_an_endpoint_alone(endpoint: str, following: str) -> None:
    assert next_port(endpoint) == following


def test_what_is_raised_in_its_thread_costs_neither_the_session_nor_its_peers() -> None:
    """To meet anew took a second and more, and some met on another port."""
    port = free_port()
    with publishing(settings_on(port)) as publisher:
        assert opened(publisher)
        with zenoh.open(tool_config(f"tcp/127.0.0.1:{port}")) as session:
            alive = session.liveliness().declare_subscriber("infant/r1/alive", FifoChannel(9), history=True)
            for number in range(1, 4):
                raise_in("publish")
                put_ticks(publisher, range(12), 0.0)  # it waits for one in C
                assert until(lambda number=number: f"({number} " in publisher.health().trouble)  # type: ignore[misc]
                assert until(lambda: publisher._queue.empty())
            put_ticks(publisher, range(100, 112), 0.0)
            assert until(lambda: any(reply.ok for reply in session.get("infant/r1/status", timeout=1.0)))
            assert [sample.kind for sample in iter(alive.try_recv, None)] == [zenoh.SampleKind.PUT]
