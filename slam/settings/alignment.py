"""[slam.front_end.alignment]: scans that come seconds apart."""

from pydantic import BaseModel, ConfigDict, Field


class AlignmentSettings(BaseModel):
    """Whether scans are aligned with earlier ones when they are too far apart in time to be compared by wheel
    odometry.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    enabled: bool = Field(
        default=True,
        description="Refine the wheels' motion by aligning scans that are seconds apart. Turn it off to study "
        "wheel odometry alone; a live laser is never that slow",
    )
