"""The fleet's router lets each rover say what is its own, and nobody in without a certificate."""

import json
from collections.abc import Iterator

import pytest
import zenoh

from runtime.publish.status import fetch_status
from tests.support.runtime.ros_types import PoseWithCovarianceStamped, read
from tests.support.zenoh.fleet import Fleet, running_fleet
from tests.support.zenoh.wire import publishing, put_ticks, until


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    with running_fleet(tmp_path_factory.mktemp("ca")) as fleet:
        yield fleet


def test_a_viewer_hears_each_rover_under_its_own_name(fleet: Fleet) -> None:
    with (
        fleet.client("viewer") as viewer,
        publishing(fleet.rover_settings("rover1"), "rover1") as first,
        publishing(fleet.rover_settings("rover2"), "rover2") as second,
    ):
        subscriber = viewer.declare_subscriber("infant/*/pose", zenoh.handlers.FifoChannel(1000))
        heard: dict[str, bytes] = {}

        def both() -> bool:
            put_ticks(first, range(1), 0.0)
            put_ticks(second, range(1), 0.0)
            while (sample := subscriber.try_recv()) is not None:
                heard[str(sample.key_expr)] = sample.payload.to_bytes()
            return len(heard) == 2

        assert until(both), heard.keys()
        assert until(lambda: any(reply.ok for reply in viewer.get("infant/rover1/status", timeout=1.0)))
        assert [status["rover"] for status in fetch_status([fleet.endpoint], 1.0, str(fleet.tool_file("viewer")))] == [
            "rover1",
            "rover2",
        ]
        tokens = {str(reply.ok.key_expr) for reply in viewer.liveliness().get("infant/*/alive") if reply.ok}
    assert read(PoseWithCovarianceStamped, heard["infant/rover2/pose"]).header.frame_id == "map"
    assert tokens == {"infant/rover1/alive", "infant/rover2/alive"}


def test_a_pose_in_the_name_of_another_rover_is_dropped(fleet: Fleet) -> None:
    with fleet.client("viewer") as viewer, fleet.client("rover1") as forger:
        subscriber = viewer.declare_subscriber("infant/**", zenoh.handlers.FifoChannel(1000))
        keys: set[str] = set()

        def own_arrived() -> bool:
            forger.put("infant/rover2/pose", b"forged")
            forger.put("infant/rover1/pose", b"own")
            while (sample := subscriber.try_recv()) is not None:
                keys.add(str(sample.key_expr))
            return "infant/rover1/pose" in keys

        assert until(own_arrived)
    assert keys == {"infant/rover1/pose"}


def test_a_viewer_says_nothing_and_a_rover_overhears_nothing(fleet: Fleet) -> None:
    with fleet.client("viewer") as viewer, fleet.client("rover1") as rover, fleet.client("rover2") as other:
        heard = {
            "by the viewer": viewer.declare_subscriber("infant/**", zenoh.handlers.FifoChannel(1000)),
            "by rover 2": other.declare_subscriber("infant/**", zenoh.handlers.FifoChannel(1000)),
        }
        got: dict[str, set[str]] = {name: set() for name in heard}

        def viewer_served() -> bool:
            rover.put("infant/rover1/pose", b"own")
            with fleet.client("viewer") as second_viewer:
                second_viewer.put("infant/rover1/pose/forged", b"x")
            for name, subscriber in heard.items():
                while (sample := subscriber.try_recv()) is not None:
                    got[name].add(str(sample.key_expr))
            return bool(got["by the viewer"])

        assert until(viewer_served)
    assert got == {"by the viewer": {"infant/rover1/pose"}, "by rover 2": set()}


def test_who_has_no_certificate_or_that_of_a_stranger_does_not_get_in(fleet: Fleet) -> None:
    bare = zenoh.Config()
    bare.insert_json5("mode", '"client"')
    bare.insert_json5("scouting/multicast/enabled", "false")
    bare.insert_json5("connect/endpoints", json.dumps([fleet.endpoint]))
    bare.insert_json5("transport/link/tls/root_ca_certificate", json.dumps(str(fleet.certificates / "ca.pem")))
    with pytest.raises(zenoh.ZError):
        zenoh.open(bare)
    (fleet.certificates / "strangers" / "ca.pem").write_bytes((fleet.certificates / "ca.pem").read_bytes())
    stranger = Fleet(fleet.certificates / "strangers", fleet.endpoint)
    with pytest.raises(zenoh.ZError):
        stranger.client("rover1")
