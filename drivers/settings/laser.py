"""[laser]: where the laser is, and what is asked of it."""

from typing import Literal, Self
from urllib.parse import parse_qs, urlsplit

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

DEFAULT_PORT = 10940
BAUDS = (115200, 19200, 57600, 38400, 250000, 500000, 750000)


class LaserSettings(BaseModel):
    """Where the laser is connected, and what it is asked for.

    Everything about the model comes from the sensor itself.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    url: str = Field(
        "tcp://192.168.0.10:10940",
        description="tcp://HOST:PORT or serial:///dev/NAME, optionally with ?baud=N for the baud rate to use. The "
        "default is the factory address of the Ethernet models; `infant setup` finds the laser",
    )
    rate_hz: float = Field(
        10.0,
        ge=0.1,
        le=50.0,
        description="Scans per second; a faster sensor is asked to skip some. Lower it, together with "
        "loop.rate_hz, on a slow computer; `infant check` warns of a rate that the sensor cannot "
        "deliver",
    )
    command: Literal["MD", "MS", "ME", "ND", "NE"] = Field(
        "MD",
        description="MD: ranges; MS: short ranges (4 m); ME: with intensity; ND and NE: several echoes. Change it "
        "to choose an echo: behind rain and glass the last one counts. Intensities are not recorded",
    )
    echo: Literal["first", "strongest", "last"] = Field(
        "first",
        description="Which of several echoes is kept; last needs ND or NE, strongest needs NE. Change it in rain, "
        "in dust or behind glass",
    )
    cluster: int = Field(
        1,
        ge=1,
        le=99,
        description="Number of neighbouring steps merged into one value, their smallest. Raise it if the link or "
        "the computer is too slow for every beam",
    )
    angle_min_deg: float | None = Field(
        None,
        ge=-180.0,
        le=180.0,
        description="First bearing, counter-clockwise from the front; absent: all beams. Set it if the laser sees "
        "the vehicle itself",
    )
    angle_max_deg: float | None = Field(
        None,
        ge=-180.0,
        le=180.0,
        description="Last bearing; absent: all beams. Set it if the laser sees the vehicle itself",
    )
    stamp_reference: Literal["step_zero", "behind"] = Field(
        "step_zero",
        description="What the device's time stamp refers to: its step 0 (SCIP 2.0 specification; the default for "
        "every model, measured only on simulated ones) or the direction straight behind. Change it if "
        "`infant calibrate` finds a latency of half a turn",
    )
    stamp_offset_s: float = Field(
        0.0,
        ge=-1.0,
        le=1.0,
        description="Time added to every stamp, for firmware whose clock is known to be off. `infant calibrate` "
        "finds it",
    )
    time_sync: bool = Field(
        True,
        description="Ask for the device's clock (TM) before streaming. Turn it off if TM is broken in the "
        "firmware: `infant check --live` then reports a laser that does not start",
    )
    reboot_on_fault: bool = Field(
        True,
        description="Reboot the sensor (RB) when it reports a malfunction. Turn it off if somebody should look at "
        "the sensor first",
    )

    @field_validator("url")
    @classmethod
    def _is_known(cls, url: str) -> str:
        endpoint(url)
        return url

    @model_validator(mode="after")
    def _are_ordered(self) -> Self:
        low, high = self.angle_min_deg, self.angle_max_deg
        if low is not None and high is not None and low >= high:
            raise ValueError(f"angle_min_deg below angle_max_deg, not {low} and {high}")
        wanted = {"first": self.command, "strongest": "NE", "last": self.command if self.command == "NE" else "ND"}
        if wanted[self.echo] != self.command:
            raise ValueError(f"command {wanted[self.echo]} for echo {self.echo}, not {self.command}")
        return self


class TcpEndpoint(BaseModel):
    """Where a laser with Ethernet listens."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    host: str
    port: int


class SerialEndpoint(BaseModel):
    """A device file; baud None: whatever the laser answers to."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    path: str
    baud: int | None


def endpoint(url: str) -> TcpEndpoint | SerialEndpoint:
    """What a URL stands for. Raises ValueError with what was expected."""
    expected = "tcp://HOST:PORT or serial:///dev/NAME, optionally with ?baud=N"
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        raise ValueError(f"{expected} ({error})") from error
    if parts.scheme == "tcp" and parts.hostname and not parts.path.strip("/") and not parts.query:
        return TcpEndpoint(host=parts.hostname, port=DEFAULT_PORT if port is None else port)
    if parts.scheme == "serial" and not parts.netloc and parts.path not in ("", "/"):
        query = parse_qs(parts.query)
        baud = query.pop("baud", [None])[-1]
        if query or (baud is not None and (not baud.isdigit() or int(baud) not in BAUDS)):
            raise ValueError(f"{expected} with N one of {', '.join(map(str, sorted(BAUDS)))}")
        return SerialEndpoint(path=parts.path, baud=None if baud is None else int(baud))
    raise ValueError(expected)
