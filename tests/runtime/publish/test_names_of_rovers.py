"""Two rovers of one name are told apart by their hosts, and the second says so."""

import socket

import pytest

from runtime.publish.status import fetch_status, host_name, named, namesake_trouble, status_table
from runtime.settings.configuration import Configuration
from tests.support.zenoh.wire import free_port, opened, publishing, put_ticks, settings_on, until


def test_the_second_rover_of_a_name_says_so_and_status_shows_both_with_their_host() -> None:
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{port}"
    with publishing(settings_on(port)) as first:
        assert opened(first)
        put_ticks(first, range(3), 0.0)
        assert first.health().trouble == ""
        assert until(lambda: bool(fetch_status((endpoint,))))
        with publishing(settings_on(port)) as second:
            where = opened(second)
            put_ticks(second, range(3), 0.0)
            assert f"another rover is called r1, on {host_name()}" in second.health().trouble
            assert until(lambda: len(fetch_status((endpoint, *where))) == 2)
            table = status_table(fetch_status((endpoint, *where)))
        assert sum(line.startswith(f"r1     {host_name()}") for line in table) == 2
        with publishing(settings_on(port), simulated=True) as third:
            assert opened(third)
            assert third.health().trouble == ""
    assert namesake_trouble("r1", (endpoint,), None) == ""


@pytest.mark.parametrize(
    ("host", "name"), [("rover7.field.example", "rover7"), ("my rover", "my-rover"), ("x" * 80, "x" * 32)]
)
def test_a_rover_without_a_name_has_that_of_its_computer(host: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: host)
    assert named(Configuration()).rover == name
    assert named(Configuration(rover="r1")).rover == "r1"
    assert Configuration.model_validate(named(Configuration()).model_dump()).rover == name
