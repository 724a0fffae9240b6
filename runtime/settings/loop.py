"""[loop]: how often the loop beats, and with which privileges."""

from pydantic import BaseModel, ConfigDict, Field


class LoopSettings(BaseModel):
    """The rate of the loop and the priority of its thread."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    rate_hz: float = Field(
        10.0,
        ge=0.1,
        le=100.0,
        description="Beats of the loop per second. Use the laser's own rate: a faster loop steps without a scan, a "
        "slower one skips scans",
    )
    priority: int = Field(
        50,
        ge=0,
        le=99,
        description="SCHED_FIFO priority of the loop's thread; 0 requests none. Keep it at or below that of the "
        "kernel's interrupt threads (50), and set 0 if the process may not have a priority",
    )
