"""How far both wheels counted while setup listened: a count that falls while the rover rolls forward needs a sign."""

from collections.abc import Sequence

from drivers.canbus.frame import CanFrame
from drivers.measurements import DriverError
from drivers.settings.encoders import EncoderSettings
from drivers.settings.layouts import Layout
from drivers.settings.vehicle import VehicleSettings
from drivers.wheels.layouts.choose import wheel_decoder
from drivers.wheels.pair import WheelPair

SIDES = ("left", "right")
FASTEST_MPS = 100.0  # no count is a jump here: radius and counts per turn are not known yet


def counts_heard(layout: Layout, frames: Sequence[CanFrame]) -> tuple[float, float] | None:
    """Counts of the left and the right wheel from the first to the last frame; None where they cannot be told."""
    vehicle = VehicleSettings(max_speed_mps=FASTEST_MPS)
    settings = EncoderSettings(layout=layout, vehicle=vehicle, speed_tolerance_m=0.0)
    try:
        pair = WheelPair(settings, wheel_decoder(settings))
    except DriverError:
        return None
    for frame in frames:
        pair.feed(frame)
    samples = [sample for sample in pair.take() if sample.valid]
    if len(samples) < 2:
        return None
    return samples[-1].left - samples[0].left, samples[-1].right - samples[0].right


def counts_line(counts: tuple[float, float]) -> str:
    """For a person who pushed the rover forward meanwhile."""
    told = " and ".join(f"{side} {count:+.0f}" for side, count in zip(SIDES, counts, strict=True))
    falls = [side for side, count in zip(SIDES, counts, strict=True) if count < 0.0]
    if not any(counts):
        return f"counts    {told}: no wheel turned"
    if not falls:
        return f"counts    {told}: both rise"
    options = " ".join(f"--reverse {side}" for side in falls)
    return f"counts    {told}: if you pushed the rover forward, this needs {options}"
