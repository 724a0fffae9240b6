"""Who may command is read from the rules, not from a flag; and a rover's session takes in little."""

import json
from pathlib import Path
from typing import Any

import pytest
import zenoh

from runtime.commands import Command
from runtime.errors import ConfigurationError, SensorError
from runtime.publish.access import LARGEST_MESSAGE, command_trouble
from runtime.publish.commands import send_command
from runtime.publish.session import rover_config, tool_config
from runtime.publish.status import fetch_status
from runtime.source_tree import CONFIG
from tests.support.zenoh.wire import free_port, opened, publishing, put_ticks, settings_on, until

QUERY = {
    "id": "q",
    "permission": "allow",
    "flows": ["ingress"],
    "key_exprs": ["infant/r1/command/*"],
    "messages": ["query"],
}
OPERATOR = {"id": "s", "cert_common_names": ["operator"]}
GOOD: dict[str, Any] = {
    "enabled": True,
    "default_permission": "deny",
    "rules": [QUERY],
    "subjects": [OPERATOR],
    "policies": [{"rules": ["q"], "subjects": ["s"]}],
}
EVERYONE, NOBODY = "so everyone", "so nobody"
RULES: dict[str, tuple[dict[str, Any], str]] = {
    "a named operator": (GOOD, ""),
    "a user name": ({**GOOD, "subjects": [{"id": "s", "usernames": ["operator"]}]}, ""),
    "this machine": ({**GOOD, "subjects": [{"id": "s", "interfaces": ["lo"]}]}, ""),
    "a key that holds the commands": ({**GOOD, "rules": [{**QUERY, "key_exprs": ["infant/**"]}]}, ""),
    "not enabled": ({**GOOD, "enabled": False}, EVERYONE),
    "default allow": ({**GOOD, "default_permission": "allow"}, EVERYONE),
    "default allow, a rule that denies something else": (
        {
            **GOOD,
            "default_permission": "allow",
            "rules": [{**QUERY, "permission": "deny", "key_exprs": ["nothing"], "messages": ["put"]}],
        },
        EVERYONE,
    ),
    "empty lists": ({**GOOD, "rules": [], "subjects": [], "policies": []}, NOBODY),
    "no lists": ({"enabled": True, "default_permission": "deny"}, NOBODY),
    "a subject that is anyone": ({**GOOD, "subjects": [{"id": "s"}]}, EVERYONE),
    "a name that is empty": ({**GOOD, "subjects": [{"id": "s", "cert_common_names": [""]}]}, EVERYONE),
    "a network": ({**GOOD, "subjects": [{"id": "s", "interfaces": ["lo", "eth0"]}]}, EVERYONE),
    "one of two subjects is anyone": (
        {
            **GOOD,
            "subjects": [OPERATOR, {"id": "t"}],
            "policies": [{"rules": ["q"], "subjects": ["s", "t"]}],
        },
        EVERYONE,
    ),
    "the commands of another rover": ({**GOOD, "rules": [{**QUERY, "key_exprs": ["infant/r2/**"]}]}, NOBODY),
    "puts only": ({**GOOD, "rules": [{**QUERY, "messages": ["put"]}]}, NOBODY),
    "a rule in no policy": ({**GOOD, "policies": []}, NOBODY),
}


@pytest.mark.parametrize("name", RULES)
def test_the_guard_of_commands_judges_the_rules(name: str) -> None:
    access, trouble = RULES[name]
    config = zenoh.Config()
    config.insert_json5("access_control", json.dumps(access))
    found = command_trouble(config, "r1")
    assert trouble in found
    assert bool(trouble) == bool(found)


def test_the_delivered_rules_let_the_router_of_a_fleet_command() -> None:
    assert command_trouble(zenoh.Config.from_file(str(CONFIG / "zenoh-rover.json5")), "rover1") == ""


@pytest.mark.parametrize("text", ["{}", '{mode: "peer"}', "{scouting: {}}"])
def test_a_file_that_is_silent_about_scouting_does_not_scout(tmp_path: Path, text: str) -> None:
    path = tmp_path / "zenoh.json5"
    path.write_text(text)
    for config in (
        rover_config(settings_on(0, config_file=str(path)), "r1", ()),
        tool_config("tcp/[::1]:1", str(path)),
    ):
        assert config.get_json("scouting/multicast/enabled") == "false"
        assert config.get_json("scouting/gossip/enabled") == "false"
    path.write_text("{scouting: {multicast: {enabled: true}}}")
    config = rover_config(settings_on(0, config_file=str(path)), "r1", ())
    assert config.get_json("scouting/multicast/enabled") == "true"


@pytest.mark.parametrize("content", [b"{a:" + b"[" * 100_000, b" " * (2 << 20), b"\xff\xfe{", b"{mode: 7}", b"\0"])
def test_a_file_that_would_end_the_process_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "zenoh.json5"
    path.write_bytes(content)
    with pytest.raises(ConfigurationError, match=r"zenoh\.json5"):
        tool_config("tcp/127.0.0.1:1", str(path))


def test_a_router_that_never_says_goodbye_is_no_trouble_of_who_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """As seen through a router that is flooded: closing timed out, and `infant status` ended with a traceback."""

    class Flooded:
        def get(self, *_: object, **__: object) -> list[zenoh.Reply]:
            return []

        def close(self) -> None:
            raise zenoh.ZError("close operation timed out!")

    monkeypatch.setattr(zenoh, "open", lambda _: Flooded())
    assert fetch_status(["tcp/127.0.0.1:1"]) == []
    with pytest.raises(SensorError, match="does not answer"):
        send_command("tcp/127.0.0.1:1", "r1", Command.SAVE, "")


def test_nobody_speaks_in_the_name_of_a_rover_through_the_rover() -> None:
    port = free_port()
    with publishing(settings_on(port)) as publisher:
        assert opened(publisher)
        with (
            zenoh.open(tool_config(f"tcp/127.0.0.1:{port}")) as forger,
            zenoh.open(tool_config(f"tcp/127.0.0.1:{port}")) as listener,
        ):
            subscriber = listener.declare_subscriber("infant/r1/pose", zenoh.handlers.FifoChannel(1000))
            heard: list[bytes] = []

            def served() -> bool:
                for key in ("infant/r1/pose", "infant/*/pose", "**"):
                    forger.put(key, b"forged")
                put_ticks(publisher, range(1), 0.0)
                while (sample := subscriber.try_recv()) is not None:
                    heard.append(sample.payload.to_bytes())
                return len(heard) >= 5

            assert until(served)
    assert b"forged" not in heard


def test_a_question_with_a_large_payload_is_dropped_before_it_is_whole() -> None:
    port = free_port()
    with publishing(settings_on(port)) as publisher:
        assert opened(publisher)
        put_ticks(publisher, range(12), 0.0)
        with zenoh.open(tool_config(f"tcp/127.0.0.1:{port}")) as session:

            def answers(payload: bytes, timeout_s: float) -> bool:
                return any(reply.ok for reply in session.get("infant/r1/status", payload=payload, timeout=timeout_s))

            assert until(lambda: answers(b"whatever it says", 1.0))
            assert not answers(bytes(4 * LARGEST_MESSAGE), 0.3)
            assert until(lambda: answers(b"", 1.0))
