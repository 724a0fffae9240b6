"""What is true of a recorded data set besides its geometry."""

from pydantic import BaseModel, ConfigDict, Field


class DataSetSettings(BaseModel):
    """Applied during import, where stamps enter: a run that exists already keeps its stamps."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    laser_latency_s: float = Field(
        default=0.0,
        ge=-1.0,
        le=1.0,
        description="How much later the data set stamps its scans than they were measured, relative to its wheels; "
        "the import subtracts it. Found by `infant calibrate`, never tuned on a score",
    )
