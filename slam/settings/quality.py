"""[slam.quality]: when the pose is called uncertain or lost."""

from pydantic import BaseModel, ConfigDict, Field


class QualitySettings(BaseModel):
    """Bounds between tracking, uncertain and lost; `infant quality` shows what they cost and find."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    lost_score: float = Field(
        default=18.0,
        gt=0,
        le=1e6,
        description="log-odds against the pose, from settled landmarks that are missed or found in plain sight, added "
        "up over scans, from which it is lost; uncertain from half of it on. Raise it where `infant quality` shows "
        "false alarms",
    )
    uncertain_blind_s: float = Field(
        default=0.8,
        gt=0,
        le=1000,
        description="time without a scan that supports the pose, s, from which it is uncertain; twice the usual gap "
        "between scans where that is longer. Raise it where the laser is known to see nothing at times",
    )
    lost_blind_s: float = Field(
        default=2.0,
        gt=0,
        le=1000,
        description="the same for lost, s, or four times the usual gap: the longest stretch that the rover may drive "
        "by its wheels alone",
    )
