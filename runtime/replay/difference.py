"""Names the first field in which a replayed estimate is not the recorded one, and how far apart the poses are."""

import dataclasses
import math
from typing import Any

import numpy as np

from runtime.messages.estimate import decode_estimate, encode_estimate
from runtime.messages.recorded_tick import RecordedTick
from slam.estimate import Estimate

TOLERANCE_M = 0.01  # between processors of two kinds; libraries for other x86-64 made 1e-14 m after 30 s (decision 49)
TOLERANCE_DEG = 0.3


@dataclasses.dataclass(slots=True)
class Deviation:
    """The largest difference between the published poses of a record and those of its replay."""

    largest_m: float = 0.0
    largest_deg: float = 0.0

    def note(self, recorded: RecordedTick, estimate: Estimate) -> None:
        """One tick; nothing where none was recorded."""
        was = recorded.estimate
        if was is None:
            return
        before, now = was.map_from_body, estimate.map_from_body
        apart_m = math.hypot(now.x_m - before.x_m, now.y_m - before.y_m)
        turned_rad = now.heading_rad - before.heading_rad
        if not math.isfinite(apart_m + turned_rad):
            apart_m, turned_rad = math.inf, 0.0
        turned_deg = abs(math.degrees(math.remainder(turned_rad, math.tau)))
        self.largest_m, self.largest_deg = max(self.largest_m, apart_m), max(self.largest_deg, turned_deg)

    @property
    def is_allowed(self) -> bool:
        """Whether another processor may be the cause."""
        return self.largest_m <= TOLERANCE_M and self.largest_deg <= TOLERANCE_DEG

    @property
    def sentence(self) -> str:
        """Both figures, with what is allowed."""
        return (
            f"the pose differs by at most {self.largest_m:.2g} m, {self.largest_deg:.2g} deg "
            f"(allowed {TOLERANCE_M:g} m, {TOLERANCE_DEG:g} deg)"
        )


def first_difference(recorded: RecordedTick, estimate: Estimate, state_hash: bytes) -> str:
    """One sentence with the tick, the field and both values, or "" when nothing differs.

    Fields are looked at in the order of Estimate, so that a pose is named before a hash.
    """
    was = recorded.estimate
    assert was is not None
    seq = recorded.tick.seq
    now = decode_estimate(encode_estimate(estimate).data)  # so that both have been through float32 where the record has
    for field in dataclasses.fields(Estimate):
        place = _difference(field.name, getattr(was, field.name), getattr(now, field.name))
        if place:
            return f"tick {seq}: {place}"
    if recorded.state_hash != state_hash:
        before = recorded.state_hash.hex() if recorded.state_hash else "none"
        return f"tick {seq}: state_hash is {state_hash.hex()}, recorded {before}"
    return ""


def _difference(name: str, was: Any, now: Any) -> str:
    """What differs in one value, looking into its parts; "" when every bit is equal."""
    if dataclasses.is_dataclass(was) and type(was) is type(now):
        for field in dataclasses.fields(was):
            place = _difference(f"{name}.{field.name}", getattr(was, field.name), getattr(now, field.name))
            if place:
                return place
        return ""
    if isinstance(was, np.ndarray) and isinstance(now, np.ndarray):
        return _array_difference(name, was, now)
    if isinstance(was, dict) and isinstance(now, dict) and was.keys() == now.keys():
        return next(filter(None, (_difference(f"{name}[{key}]", was[key], now[key]) for key in was)), "")
    if isinstance(was, float) and isinstance(now, float):
        equal = np.float64(was).tobytes() == np.float64(now).tobytes()
    else:
        equal = type(was) is type(now) and was == now  # None beside an array, which == would compare one by one
    return "" if equal else f"{name} is {now!r}, recorded {was!r}"


def _array_difference(name: str, was: "np.ndarray[Any, Any]", now: "np.ndarray[Any, Any]") -> str:
    if was.shape != now.shape:
        return f"{name} has shape {now.shape}, recorded {was.shape}"
    if was.tobytes() == now.tobytes():
        return ""
    for index in np.ndindex(was.shape):
        if was[index].tobytes() != now[index].tobytes():
            place = ", ".join(str(part) for part in index)
            return f"{name}[{place}] is {now[index].item()!r}, recorded {was[index].item()!r}"
    return ""
