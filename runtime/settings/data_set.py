"""What is true of a recorded data set besides its geometry."""

from pydantic import BaseModel, ConfigDict, Field


class DataSetSettings(BaseModel):
    """Applied while importing, where stamps enter: a run that exists already keeps the stamps that it has."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    laser_latency_s: float = Field(
        default=0.0,
        ge=-1.0,
        le=1.0,
        description="s by which the set stamps scans later than it measured them, relative to its wheels; the importer "
        "takes it off. Found by `infant calibrate`, never tuned on a score",
    )
