"""Frames of one wheel that belong together: where they are, and how far they have come."""

from dataclasses import dataclass

from drivers.wheels.readings import WheelReading


@dataclass(slots=True)
class FrameSequence:
    """Last frame of one sequence of frames that belong together. gained: counts since its first frame; has_jumped: no
    wheel can have turned to that one.
    """

    stamp_ns: int
    reading: WheelReading
    confirmed: int = 1
    gained: float = 0.0
    has_jumped: bool = False
