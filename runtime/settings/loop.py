"""[loop]: how often the loop beats, and with which privileges."""

from pydantic import BaseModel, ConfigDict, Field


class LoopSettings(BaseModel):
    """The fixed grid and the privileges of its thread."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    rate_hz: float = Field(10.0, gt=0.0, le=100.0, description="beats per second; the laser's own rate")
    priority: int = Field(50, ge=0, le=99, description="SCHED_FIFO priority of the loop's thread; 0 asks for none")
