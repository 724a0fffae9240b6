import pytest
from pydantic import ValidationError

from drivers.settings.laser import LaserSettings, SerialEndpoint, TcpEndpoint, endpoint


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("tcp://192.168.0.10:10940", TcpEndpoint(host="192.168.0.10", port=10940)),
        ("tcp://192.168.0.10", TcpEndpoint(host="192.168.0.10", port=10940)),
        ("tcp://[::1]:77/", TcpEndpoint(host="::1", port=77)),
        ("serial:///dev/infant/lidar", SerialEndpoint(path="/dev/infant/lidar", baud=None)),
        ("serial:///dev/ttyUSB0?baud=19200", SerialEndpoint(path="/dev/ttyUSB0", baud=19200)),
    ],
)
def test_a_url_names_one_endpoint(url: str, expected: TcpEndpoint | SerialEndpoint) -> None:
    assert endpoint(url) == expected


@pytest.mark.parametrize(
    "url",
    [
        *("", "192.168.0.10", "udp://1.2.3.4:5", "tcp://", "tcp://h:99999", "tcp://h:1/path", "tcp://h?baud=1"),
        *("serial://", "serial:///", "serial:///dev/x?baud=12345", "serial:///dev/x?speed=19200"),
        *("serial://host/dev/x", "tcp://[::1"),
    ],
)
def test_any_other_url_is_refused_with_the_forms_that_are_expected(url: str) -> None:
    with pytest.raises(ValidationError, match="tcp://HOST:PORT or serial:///dev/NAME"):
        LaserSettings(url=url)


def test_angles_in_the_wrong_order_are_refused() -> None:
    with pytest.raises(ValidationError, match="angle_min_deg below angle_max_deg"):
        LaserSettings(angle_min_deg=10.0, angle_max_deg=10.0)
    with pytest.raises(ValidationError, match="Extra inputs"):
        LaserSettings.model_validate({"adress": "x"})


def test_an_echo_is_refused_with_a_command_that_does_not_send_it() -> None:
    for echo, command, wanted in (("strongest", "ND", "NE"), ("strongest", "MD", "NE"), ("last", "ME", "ND")):
        with pytest.raises(ValidationError, match=f"command {wanted} for echo {echo}, not {command}"):
            LaserSettings.model_validate({"echo": echo, "command": command})
    for echo, command in (("last", "ND"), ("last", "NE"), ("strongest", "NE"), ("first", "MD")):
        assert LaserSettings.model_validate({"echo": echo, "command": command}).echo == echo


@pytest.mark.parametrize("rate_hz", [1e-300, 0.0, -1.0, float("nan"), float("inf"), 1e300])
def test_a_rate_that_no_laser_has_is_refused(rate_hz: float) -> None:
    with pytest.raises(ValidationError, match="rate_hz"):
        LaserSettings(rate_hz=rate_hz)
