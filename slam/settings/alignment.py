"""[slam.front_end.alignment]: scans that come seconds apart."""

from pydantic import BaseModel, ConfigDict, Field


class AlignmentSettings(BaseModel):
    """Whether a scan is laid onto earlier ones where scans are too far apart in time to be compared by the wheels."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    enabled: bool = Field(
        default=True,
        description="refine the wheels' motion by the scans where these come seconds apart. Off where a study wants "
        "the wheels alone; a live laser never comes so slowly",
    )
