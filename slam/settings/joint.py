"""[slam.joint]: the joint Gaussian beside the particles, whose pose is published."""

from pydantic import BaseModel, ConfigDict, Field

MOST_SET = 768  # a step of more takes longer than any beat


class JointSettings(BaseModel):
    """How the published pose, its covariance and the published map are computed."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    landmarks_in_state: int = Field(
        96,
        ge=2,
        le=MOST_SET,
        description="Number of landmarks in the joint state. At least half as many distant ones are kept, however "
        "many are near: they hold the map together when a loop closes. The cost of a step grows with "
        "the square: lower it if `infant bench` shows steps close to the beat, raise it for large loops",
    )
