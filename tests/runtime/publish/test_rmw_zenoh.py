"""A node under rmw_zenoh finds the rover: keys, liveliness tokens, attachments, and what is latched."""

import struct

import pytest
import zenoh
import zenoh.ext
from zenoh.handlers import FifoChannel

from runtime.publish.ros2_keys import publisher_gid
from runtime.publish.session import rover_config, tool_config
from runtime.publish.topics import ROS2_TYPES
from tests.support.runtime.ros_types import TransformMessage, read
from tests.support.zenoh.router import start_router, stop_router
from tests.support.zenoh.wire import free_port, listening, opened, publishing, put_ticks, settings_on, until

SENT = set(ROS2_TYPES) - {"diagnostics"}  # the health comes with a state
TEXT = "@ros2_lv/0/" * 100


@pytest.mark.parametrize(
    ("length", "gid"),
    [
        (100, "79e6f1ad9345eb279662d206cb1996de"),
        (230, "6b59e34b17c6687d86c063ef6a3a6234"),
    ],
)
def test_the_gid_is_what_the_reference_library_of_xxhash_says(length: int, gid: str) -> None:
    assert publisher_gid(TEXT[:length]).hex() == gid  # libxxhash 0.8.1


def test_ros2_sees_all_topics_under_the_right_type_hash_and_as_what_their_tokens_say() -> None:
    port = free_port()
    settings = settings_on(port, ros2=True)
    with publishing(settings, "rover-1") as publisher, listening(f"tcp/127.0.0.1:{port}", "0/**") as listener:
        for seq in range(200):
            put_ticks(publisher, range(seq, seq + 1), 0.0)
            if until(lambda: {message["key"].split("/")[-3] for message in listener.messages} >= SENT, 0.05):
                break
        with zenoh.open(tool_config(f"tcp/127.0.0.1:{port}")) as session:
            tokens: list[str] = []

            def alive() -> bool:
                tokens[:] = [str(r.ok.key_expr) for r in session.liveliness().get("@ros2_lv/**", timeout=1.0) if r.ok]
                return len(tokens) == 2 + len(ROS2_TYPES)

            assert until(alive), tokens
    keys = {message["key"]: message for message in listener.messages}
    pose_key = (
        "0/rover_1/pose/geometry_msgs::msg::dds_::PoseWithCovarianceStamped_/"
        "RIHS01_26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e"
    )
    tf_key = (
        "0/tf/tf2_msgs::msg::dds_::TFMessage_/RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
    )
    assert pose_key in keys
    transforms = read(TransformMessage, bytes.fromhex(keys[tf_key]["payload"])).transforms
    assert [(each.header.frame_id, each.child_frame_id) for each in transforms] == [
        ("map", "odom"),
        ("odom", "base_link"),
    ]
    (pose_token,) = [token for token in tokens if "/MP/" in token and "%rover_1%pose/" in token]
    assert pose_token.endswith("::,10:,:,:,,")
    _, _, size, gid = struct.unpack("<qqB16s", bytes.fromhex(keys[pose_key]["attachment"]))
    assert (size, gid) == (16, publisher_gid(pose_token))


def test_a_ros2_node_that_knows_only_its_router_hears_the_rover() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = start_router(endpoint)
    try:
        config = rover_config(settings_on(free_port(), connect=(endpoint,), ros2=True), "r1", ("tcp/127.0.0.1:0",))
        config.insert_json5("access_control/enabled", "false")  # a rover hears nothing; a node does
        with (
            publishing(settings_on(free_port(), connect=(endpoint,), ros2=True)) as publisher,
            zenoh.open(config) as node,
        ):
            subscriber = node.declare_subscriber("0/r1/pose/**", zenoh.handlers.FifoChannel(100))
            assert until(lambda: bool(put_ticks(publisher, range(1), 0.0)) and subscriber.try_recv() is not None)
    finally:
        stop_router(router)


def test_humble_sees_keys_and_tokens_without_a_hash() -> None:
    port = free_port()
    settings = settings_on(port, ros2="humble", ros2_domain=7)
    key = "7/r1/pose/geometry_msgs::msg::dds_::PoseWithCovarianceStamped_/TypeHashNotSupported"
    with publishing(settings) as publisher:
        assert opened(publisher)
        with zenoh.open(tool_config(f"tcp/127.0.0.1:{port}")) as node:
            subscriber = node.declare_subscriber(key, FifoChannel(100))
            assert until(lambda: bool(put_ticks(publisher, range(1), 0.0)) and subscriber.try_recv() is not None)
            replies = [reply.ok for reply in node.liveliness().get("@ros2_lv/7/**", timeout=2.0)]
    published = [str(reply.key_expr) for reply in replies if reply is not None and "/MP/" in str(reply.key_expr)]
    assert len(published) == len(ROS2_TYPES) + 1
    assert all(token.split("/")[-2] == "TypeHashNotSupported" for token in published)


def test_a_node_that_comes_late_gets_the_mount_of_the_laser() -> None:
    port = free_port()
    samples: list[zenoh.Sample] = []

    def arrived() -> bool:
        samples.extend(sample for sample in (latched.try_recv(),) if sample is not None)
        return bool(samples)

    with publishing(settings_on(port, ros2=True)) as publisher:
        assert opened(publisher)
        with zenoh.open(tool_config(f"tcp/127.0.0.1:{port}")) as node:
            history = zenoh.ext.HistoryConfig(detect_late_publishers=True)
            latched = zenoh.ext.declare_advanced_subscriber(node, "0/tf_static/**", FifoChannel(9), history=history)
            assert until(arrived)
    (transform,) = read(TransformMessage, samples[-1].payload.to_bytes()).transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("base_link", "laser")
