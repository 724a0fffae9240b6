"""[slam.quality]: when the pose is called uncertain or lost."""

from pydantic import BaseModel, ConfigDict, Field


class QualitySettings(BaseModel):
    """Thresholds between tracking, uncertain and lost; `infant quality` shows how soon they react and how often
    they err.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    lost_score: float = Field(
        default=18.0,
        ge=1,
        le=1e6,
        description="Log-odds against the pose at which it is lost, and at half of which it is uncertain. They "
        "come from settled landmarks that are missed or seen as expected, summed over scans. Raise it "
        "if `infant quality` shows false alarms",
    )
    uncertain_blind_s: float = Field(
        default=0.8,
        ge=0.05,
        le=1000,
        description="Time without a scan that supports the pose before it is uncertain, and never less than twice "
        "the usual gap between scans. Raise it if the laser is known to see nothing at times",
    )
    lost_blind_s: float = Field(
        default=2.0,
        ge=0.05,
        le=1000,
        description="The same before the pose is lost, and never less than four times the usual gap; only time in "
        "which the rover moves counts. Choose the longest stretch that it may drive on its wheels alone",
    )
