"""`infant status` shows good rovers whatever anybody else answers."""

import json
from typing import Any

import pytest
import zenoh

from runtime.publish.rover_status import LARGEST_BYTES, LONGEST_TEXT, believed
from runtime.publish.session import tool_config
from runtime.publish.status import fetch_status, status_line, status_table
from tests.runtime.publish.test_status import made_status
from tests.support.zenoh.wire import free_port, opened, publishing, put_ticks, settings_on, until

KEY = "infant/r1/status"
GOOD = made_status("r1")


def said(**changes: Any) -> bytes:
    return json.dumps({**GOOD, **changes}).encode()


ANSWERS: dict[str, bytes] = {
    "no text": b"\xff\xfe",
    "nothing": b"",
    "a list": b"[]",
    "no fields": b"{}",
    "brackets without end": b"[" * 50_000,
    "another rover": said(rover="r2"),
    "a rover that is a list": said(rover=["r1"]),
    "a number that is text": said(rate_hz="x"),
    "a number that is none": said(rate_hz=float("nan")),
    "a number without end": said(seq=10**400),
    "half a pose": said(sigma=None),
    "a pose that is a list": said(pose=[0, 0, 0]),
    "sensors that are a list": said(sensors=[]),
    "a sensor without a state": said(sensors={"laser": {}}),
    "a figure that is text": said(sensors={"laser": {**GOOD["sensors"]["laser"], "figures": {"x": "y"}}}),
    "a thousand reasons": said(reasons=["x"] * 1000),
    "a reason of a megabyte": said(reasons=["x" * 1_000_000]),
    "more than a status has": b" " * (LARGEST_BYTES + 1),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_an_answer_that_is_no_status_is_refused_in_one_printable_sentence(name: str) -> None:
    with pytest.raises(ValueError, match=KEY) as refused:
        believed(KEY, ANSWERS[name])
    assert str(refused.value).isprintable()
    assert len(str(refused.value)) < 400


@pytest.mark.parametrize(
    "key", ["infant/r1/status/x", "infant/\x1b[2J/status", "infant/*/status", f"infant/{'r' * 33}/status"]
)
def test_only_the_key_of_a_rover_is_one(key: str) -> None:
    with pytest.raises(ValueError, match="not the status of a rover"):
        believed(key, said())


def test_a_good_answer_is_shown_and_its_texts_move_no_cursor() -> None:
    status = believed(
        KEY, said(reasons=["\x1b[2J\nFAKE  running"], state="\x9bdegraded", listening=[], more="than we know")
    )
    shown = [*status_table([status]), status_line(status)]
    assert all(line.isprintable() for line in shown)
    assert "\\x1b[2J\\nFAKE" in shown[1]
    assert believed(KEY, said()) == {**GOOD, "listening": [], "host": "", "instance": ""}


def test_a_rover_with_a_long_trouble_is_shown_and_the_trouble_cut() -> None:
    trouble = "x" * 3000
    (reason,) = believed(KEY, said(reasons=[trouble]))["reasons"]
    assert reason == f"{trouble[:LONGEST_TEXT]} ... (3000 characters)"


def test_a_good_rover_is_shown_beside_others_that_answer_anything() -> None:
    port = free_port()
    endpoint, refused = f"tcp/127.0.0.1:{port}", list[str]()
    with publishing(settings_on(port, config_file=None), "good") as publisher:
        assert opened(publisher)
        put_ticks(publisher, range(12), 0.0)
        second = f"tcp/127.0.0.1:{free_port()}"
        config = tool_config(endpoint)
        config.insert_json5("mode", '"peer"')
        config.insert_json5("listen/endpoints", json.dumps([second]))
        with zenoh.open(config) as liar:

            def lie(query: zenoh.Query) -> None:
                with query:
                    query.reply("infant/liar/status", b"[" * 50_000)

            liar.declare_queryable("infant/liar/status", zenoh.handlers.Callback(lie, indirect=False))
            found: list[dict[str, Any]] = []

            def both() -> bool:
                refused.clear()
                found[:] = fetch_status([second, endpoint], 1.0, refused=refused.append)
                return bool(found) and bool(refused)

            assert until(both)
    assert [status["rover"] for status in found] == ["good"]
    assert refused[0].startswith("infant/liar/status is not a valid status")
