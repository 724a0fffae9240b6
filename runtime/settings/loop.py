"""[loop]: how often the loop beats, and with which privileges."""

from pydantic import BaseModel, ConfigDict, Field


class LoopSettings(BaseModel):
    """The fixed grid and the privileges of its thread."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    rate_hz: float = Field(
        10.0,
        gt=0.0,
        le=100.0,
        description="beats per second. The laser's own rate: a faster loop steps without a scan, a slower one "
        "leaves scans out",
    )
    priority: int = Field(
        50,
        ge=0,
        le=99,
        description="SCHED_FIFO priority of the loop's thread; 0 asks for none. Below that of the drivers' "
        "interrupts (50 in the kernel); 0 where the process may not have one",
    )
