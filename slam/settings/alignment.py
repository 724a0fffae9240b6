"""Settings of the alignment of scans that are seconds apart."""

from pydantic import BaseModel, ConfigDict, Field


class AlignmentSettings(BaseModel):
    """How a scan is laid onto earlier ones where the scans are too far apart in time to be compared by the wheels."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    enabled: bool = Field(
        default=True, description="refine the wheels' motion by the scans where these come seconds apart"
    )
    scans: int = Field(default=5, ge=1, le=50, description="a scan is laid onto so many earlier ones")
    points: int = Field(default=200, ge=20, le=5000, description="at most so many beams of a scan are used")
    gate_first_m: float = Field(
        default=1.0,
        gt=0.0,
        le=5.0,
        description="points farther from the nearest surface are left out at first, m; what 10 deg move at 6 m",
    )
    gate_last_m: float = Field(
        default=0.15, gt=0.0, le=1.0, description="the same at the end, m: five times the roughness of a wall"
    )
    starts: int = Field(
        default=3,
        ge=1,
        le=31,
        description="headings that the search starts from, up to three deviations from that of the wheels",
    )
    narrowing_steps: int = Field(default=6, ge=1, le=100, description="steps from the first gate to the last")
    final_steps: int = Field(default=10, ge=1, le=100, description="at most so many steps at the last gate, all points")
    coarse_points: int = Field(default=60, ge=10, le=5000, description="at most so many points while the gate narrows")
    sigma_m: float = Field(
        default=0.03, gt=0.0, le=1.0, description="distance of a point from a surface seen before, m: noise and clutter"
    )
    wheels_sigma_m: float = Field(
        default=0.02, gt=0.0, le=1.0, description="m; over seconds the wheels and the laser's mount are not more exact"
    )
    wheels_sigma_rad: float = Field(default=0.01, gt=0.0, le=1.0, description="rad; the same for turns")
    correlated_beams: float = Field(
        default=2.0,
        ge=1.0,
        le=100.0,
        description="so many neighbouring beams say the same thing; with 1 the covariance is still wide in simulation",
    )
    least_points: int = Field(default=25, ge=3, le=5000, description="with fewer points on surfaces nothing is refined")
    least_share: float = Field(
        default=0.3, ge=0.0, le=1.0, description="nor with a smaller share of the points that came back"
    )
    widest_square: float = Field(
        default=30.0,
        gt=0.0,
        le=1e6,
        description="nor where the result contradicts the wheels by this squared distance",
    )
