"""What a person types to see and to command a rover, against one that is there."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from runtime.cli.__main__ import app
from runtime.errors import ConfigurationError, SensorError, UsageError
from runtime.publish.publisher import ZenohPublisher
from tests.support.zenoh.wire import free_port, opened, publishing, put_ticks, settings_on, until

RULES = """{access_control: {enabled: true, default_permission: "deny",
  rules: [{id: "local", permission: "allow", flows: ["ingress", "egress"], key_exprs: ["infant/**"],
           messages: ["query", "reply", "put", "declare_queryable", "declare_subscriber"]}],
  subjects: [{id: "here", interfaces: ["lo"]}], policies: [{rules: ["local"], subjects: ["here"]}]}}"""


@pytest.fixture
def rover(tmp_path: Path) -> Iterator[tuple[ZenohPublisher, str]]:
    """A rover that takes commands from this machine, and where it is."""
    file, port = tmp_path / "rules.json5", free_port()
    file.write_text(RULES)
    with publishing(settings_on(port, commands=True, config_file=str(file))) as publisher:
        assert opened(publisher)
        yield publisher, f"tcp/127.0.0.1:{port}"


def test_a_mark_typed_here_is_an_event_there(rover: tuple[ZenohPublisher, str]) -> None:
    publisher, endpoint = rover
    typed = ["command", "mark", "people walked by", "--rover", "r1", "--connect", endpoint]
    said = CliRunner().invoke(app, [*typed, "--json"])
    assert json.loads(said.stdout) == {"rover": "r1", "command": "mark", "accepted": True, "reason": ""}
    assert [(event.kind, event.reason) for event in publisher.drain_events()] == [("mark", "people walked by")]
    assert "accepted mark" in CliRunner().invoke(app, typed).stdout


def test_what_the_rover_refuses_says_why(rover: tuple[ZenohPublisher, str]) -> None:
    said = CliRunner().invoke(app, ["command", "mark", "--rover", "r1", "--connect", rover[1]])
    assert isinstance(said.exception, UsageError)
    assert "r1 refused mark: expected a reason" in str(said.exception)


def test_nobody_there_is_one_sentence(rover: tuple[ZenohPublisher, str], tmp_path: Path) -> None:
    elsewhere = ["command", "save", "--connect", f"tcp/127.0.0.1:{free_port()}"]
    assert isinstance(CliRunner().invoke(app, elsewhere).exception, SensorError)
    unknown = CliRunner().invoke(app, ["command", "save", "--rover", "r2", "--connect", rover[1]])
    assert "does not answer infant/r2/command/save" in str(unknown.exception)
    nowhere = CliRunner().invoke(app, ["command", "save", "--zenoh", str(tmp_path / "no.json5")])
    assert isinstance(nowhere.exception, ConfigurationError)
    assert "--zenoh" in str(nowhere.exception)


def test_watching_for_a_rover_that_is_not_there_says_so_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing at all was shown, for as long as one waited."""
    monkeypatch.setattr("runtime.publish.status.watch_status", lambda *_words: iter([[], [], []]))
    watched = CliRunner().invoke(app, ["status", "--watch"])
    assert watched.exit_code == 0
    assert watched.output.count("no rover answers at") == 1
    assert "waiting until one does" in watched.output


def test_status_prints_a_row_for_each_rover(rover: tuple[ZenohPublisher, str]) -> None:
    publisher, endpoint = rover
    printed: list[str] = []

    def answered() -> bool:
        put_ticks(publisher, range(1), 0.0)
        printed[:] = CliRunner().invoke(app, ["status", "--connect", endpoint]).stdout.splitlines()
        return len(printed) == 2

    assert until(answered), printed
    assert printed[0].split()[:3] == ["rover", "host", "state"]
    assert printed[1].split()[0] == "r1"


def test_the_bridge_is_in_the_domain_of_the_nodes_that_are_started_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "999")
    refused = CliRunner().invoke(app, ["bridge", "ros2"])
    assert "--domain 999: expected 0 to 232" in str(refused.exception)
