"""[encoders]: the bus, and where in its frames the counts are."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from drivers.settings.can import BusSettings
from drivers.settings.layouts import DbcLayout, Layout
from drivers.settings.vehicle import VehicleSettings

DEGRADED_PERIODS = 3  # silence after which a wheel is degraded ...
DEGRADED_AT_LEAST_NS = 60_000_000  # ... and never a shorter one: a reader that is held up is no silence of a node
SILENT_PERIODS = 10  # silence after which the samples are invalid
SILENT_AT_LEAST_NS = 200_000_000


class WheelSettings(BaseModel):
    """One wheel's counter."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    sign: Literal[1, -1] = Field(
        default=1,
        description="-1 if the counter falls while the rover drives forward. Push the rover forward and look: "
        "`infant check --live` shows both counts",
    )
    modulus: int = Field(
        default=0,
        ge=0,
        le=2**63,
        description="Where the counter wraps (65536, 9000, object 6002h); 0 if it uses the whole width of its "
        "signal. Set it, from the data sheet, for a counter that starts again with each turn",
    )


class EncoderSettings(BaseModel):
    """How the wheels are read; their geometry is in [vehicle]."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    vehicle: VehicleSettings = VehicleSettings()  # handed on from the table [vehicle], no key of [encoders]
    bus: BusSettings = Field(default_factory=BusSettings)
    layout: Layout = Field(default_factory=DbcLayout)
    left: WheelSettings = Field(default_factory=WheelSettings)
    right: WheelSettings = Field(default_factory=WheelSettings)
    period_ms: float = Field(
        default=20.0,
        ge=1.0,
        le=1000.0,
        description="Time between two frames of one wheel. Take what the node is set to; a node that reports "
        "another period is named in the review",
    )
    speed_tolerance_m: float = Field(
        default=0.008,
        ge=0.0,
        le=10.0,
        description="How far counts and speed signal may drift apart in half a second. Keep it below 1 cm, so that "
        "a stuck counter never turns the rover; 0 turns the comparison off, for devices that filter "
        "their speed",
    )

    @property
    def counts_per_metre(self) -> float:
        """Counts for one metre rolled."""
        return self.vehicle.counts_per_metre

    @property
    def period_ns(self) -> int:
        """Time between two frames of one wheel."""
        return round(self.period_ms * 1e6)

    @property
    def degraded_ns(self) -> int:
        """Silence after which a wheel is degraded."""
        return max(DEGRADED_PERIODS * self.period_ns, DEGRADED_AT_LEAST_NS)

    @property
    def silent_ns(self) -> int:
        """Silence after which a node may have been off, and nothing is known of its wheel."""
        return max(SILENT_PERIODS * self.period_ns, SILENT_AT_LEAST_NS)
