"""Settings of the simulated laser, and the faults that can be asked of it."""

from enum import StrEnum
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class FaultKind(StrEnum):
    """What can go wrong with a laser or with its cable."""

    OFF = "off"  # no power: nothing listens; starts from zero afterwards
    STUCK = "stuck"  # the same ranges again and again, with running stamps
    GARBAGE = "garbage"  # random bytes in place of every message
    WRONG = "wrong"  # scans with another number of steps than was asked for
    SLOW = "slow"  # only every n-th scan
    DELAYED = "delayed"  # every message late by the same time
    INTERMITTENT = "intermittent"  # messages get lost at random
    CUT = "cut"  # the connection breaks and cannot be made; the laser goes on
    POWER_CYCLE = "power_cycle"  # off and on again
    HALF_MESSAGE = "half_message"  # every scan ends in its middle
    BAD_CHECKSUM = "bad_checksum"  # one character of every scan is another
    SILENCE = "silence"  # connected, but says nothing
    STATUS = "status"  # a status in place of every scan
    STALE_STAMP = "stale_stamp"  # the device's stamp stands still
    CLOCK_RESET = "clock_reset"  # the device's clock jumps to zero in the middle of a stream


class LaserFault(BaseModel):
    """One fault, from the configuration or injected while running."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: FaultKind = Field(description="what goes wrong")
    start_s: float = Field(0.0, ge=0.0, le=86400.0, description="s after the device's start, or after injection")
    duration_s: float | None = Field(None, ge=0.001, le=86400.0, description="s; absent: until it is cleared")
    status: str = Field(
        "0L",
        pattern=r"^(0L|0M|[2-8][0-9]|9[0-7])$",
        description="for status: its code; after 0L and 50 to 97 the laser needs a reboot (RB)",
    )
    delay_s: float = Field(0.3, ge=0.001, le=10.0, description="s, for delayed; well above the jitter of a network")
    keep_every: int = Field(3, ge=2, le=100, description="for slow: one scan of so many is sent")
    loss: float = Field(0.5, ge=0.001, le=1.0, description="for intermittent: share of messages lost")


LaserModel = Literal["UTM-X001S", "UTM-30LX", "UTM-30LX-EW", "UST-10LX", "UST-20LX", "URG-04LX", "UXM-30LX-E"]


class SimulatedLaserSettings(BaseModel):
    """The simulated laser and its clock."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    model: LaserModel = Field(
        "UTM-X001S",
        description="Model of the simulated laser; the default is that of the rover. Change it to try a model "
        "before buying it",
    )
    speed_rpm: int | None = Field(None, ge=60, le=6000, description="turns a minute (SCAN); absent: as the profile")
    host: str = Field(
        "127.0.0.1",
        description="Address at which it listens. Give another to reach it from other machines; `infant sim "
        "--listen` does the same",
    )
    port: int = Field(
        0,
        ge=0,
        le=65535,
        description="TCP port; 0 takes any free one. Fix it for a client that must be told where to connect",
    )
    pty: str | None = Field(
        None,
        description="Path of a link to a pseudo-terminal that is served too. Set it for a client on a serial line; "
        "`infant sim --pty` does the same",
    )
    skew_ppm: float = Field(
        20.0, ge=-2000.0, le=2000.0, description="ppm by which the device's clock is faster; a crystal's"
    )
    clock_start_ms: int = Field(
        0, ge=0, lt=1 << 24, description="ms, device clock at the start; 2^24 - 10000 wraps after ten seconds"
    )
    boot_s: float = Field(0.4, ge=0.0, le=60.0, description="s from power-on until it listens; real ones take over 2 s")
    reboot_disconnect_s: float = Field(0.2, ge=0.0, le=5.0, description="s from RB until the link drops; real ones 1 s")
    pace: float = Field(1.0, ge=0.1, le=100.0, description="how many times faster than real time it turns; for tests")
    seed: int = Field(1, ge=0, le=2**32 - 1, description="for faults that strike at random")
    faults: tuple[LaserFault, ...] = Field(
        (),
        description='Faults that come by themselves, such as `[{ kind = "silence", start_s = 10, duration_s = 2 }]`; '
        "`help` in `infant sim` lists them. Set it for a test that has to fail in the same way each time",
    )
