"""[slam.joint]: the joint Gaussian beside the particles, whose pose is published."""

from pydantic import BaseModel, ConfigDict, Field


class JointSettings(BaseModel):
    """How the published pose, its covariance and the published map come about."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    landmarks_in_state: int = Field(
        96,
        ge=2,
        le=4096,
        description="landmarks in the joint state, and half as many far ones at least, however many are near: they "
        "hold the map together when a loop closes. A step costs the square: lower it where `infant bench` shows steps "
        "near the beat, raise it for large loops",
    )
