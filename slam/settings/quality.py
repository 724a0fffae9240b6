"""[slam.quality]: when the pose is called uncertain or lost."""

from pydantic import BaseModel, ConfigDict, Field


class QualitySettings(BaseModel):
    """Bounds between tracking, uncertain and lost."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    settled_scans: int = Field(
        default=30, ge=1, le=100_000, description="scans after which a landmark speaks for or against the pose"
    )
    lost_score: float = Field(
        default=30.0,
        gt=0,
        le=1e6,
        description="settled landmarks missed in plain sight, less those found, added up over scans, never below 0; "
        "uncertain from half of it on",
    )
    found_share: float = Field(
        default=0.03,
        ge=0,
        le=1,
        description="of the settled landmarks in range, over some scans; where less is found, chance finds it",
    )
    uncertain_blind_s: float = Field(default=0.8, gt=0, le=1000, description="s without a scan that supports the pose")
    lost_blind_s: float = Field(default=2.0, gt=0, le=1000, description="s; the same")
    lost_blind_scans: int = Field(
        default=20,
        ge=1,
        le=100_000,
        description="scans in a row that do not support the pose; then the map is left as it is",
    )
    uncertain_m: float = Field(
        default=1.0, gt=0, le=100, description="m; standard deviation of the position, larger axis"
    )
    lost_m: float = Field(default=5.0, gt=0, le=1000, description="m; the same")
    uncertain_gap_m: float = Field(
        default=1.5, gt=0, le=100, description="m between particles and joint Gaussian beyond 3 sigma of it"
    )
    uncertain_square: float = Field(
        default=8.0,
        gt=0,
        le=1000,
        description="mean squared Mahalanobis distance of what is found, over a second; 2 is consistent",
    )
    lost_sigma_m: float = Field(
        default=10.0,
        ge=0,
        le=1000,
        description="m; standard deviation that is added to the published position while it is lost",
    )
    lost_sigma_rad: float = Field(
        default=1.8, ge=0, le=4, description="rad; the same for the heading: any heading is as likely as any other"
    )
