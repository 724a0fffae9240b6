"""One signal of a message: its value in the wanted unit, and the raw values that it can have."""

import math
from dataclasses import dataclass

from cantools.database.can import Message

from drivers.measurements import DriverError

SENTINEL_BITS = 8  # in fewer bits all ones are a value like any other
MOST_NAMED = 12
LEAST_FACTOR = 1e-15  # of counts in one bit, and one over the most
HALF_STEP = 0.5  # of the raw value: a range is written down with rounded ends


@dataclass(frozen=True, slots=True)
class Quantity:
    """Signal name with the factor and the offset from raw value to the wanted unit."""

    name: str
    factor: float
    offset: float = 0.0

    def value(self, raw: float) -> float:
        """The raw value in the wanted unit; an int stays one where the factor is 1."""
        return raw if self.factor == 1.0 and self.offset == 0.0 else raw * self.factor + self.offset

    def raw(self, value: float) -> float:
        """The other way: the raw value that says this, not rounded."""
        return value if self.factor == 1.0 and self.offset == 0.0 else (value - self.offset) / self.factor


def quantity(message: Message, name: str, unit_factor: float) -> Quantity:
    """The signal's own scale times a factor. Raises DriverError for a name that the message does not have."""
    signal = signal_of(message, name)
    conversion = signal.conversion
    scale, offset = float(getattr(conversion, "scale", 1.0)), float(getattr(conversion, "offset", 0.0))
    factor = scale * unit_factor
    if not LEAST_FACTOR <= abs(factor) <= 1.0 / LEAST_FACTOR or not abs(offset) < 1.0 / LEAST_FACTOR:  # false for NaN
        raise DriverError(
            f"signal {name} of message {message.name} has the scale ({scale:g},{offset:g}); correct the file"
        )
    return Quantity(name, factor, offset * unit_factor)


def signal_of(message: Message, name: str):  # type: ignore[no-untyped-def]  # cantools exports no type for it
    """The signal, or a sentence with the names that there are."""
    for signal in message.signals:
        if signal.name == name:
            return signal
    names = [signal.name for signal in message.signals]
    known = ", ".join(names[:MOST_NAMED]) or "no signal that can be read"
    known += f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    raise DriverError(f"signal {name}: message {message.name} has only {known}; correct the name in the layout")


def sentinels(signal) -> frozenset[int]:  # type: ignore[no-untyped-def]  # cantools exports no type for it
    """Raw values by which devices say "not available": all ones (SAE J1939-71), or the ends of a signed range."""
    if signal.conversion.is_float or signal.length < SENTINEL_BITS:
        return frozenset()
    if signal.is_signed:
        return frozenset({-(2 ** (signal.length - 1)), 2 ** (signal.length - 1) - 1})
    return frozenset({2**signal.length - 1})


def raw_limits(signal) -> tuple[float, float] | None:  # type: ignore[no-untyped-def]
    """Raw values between which a signal lies by its layout; None where that says nothing (none, or 0 to 0)."""
    low, high = signal.minimum, signal.maximum
    if low is None or high is None or not low < high:
        return None
    scale = float(getattr(signal.conversion, "scale", 1.0)) or 1.0
    offset = float(getattr(signal.conversion, "offset", 0.0))
    ends = sorted(((float(low) - offset) / scale, (float(high) - offset) / scale))
    return ends[0] - HALF_STEP, ends[1] + HALF_STEP


def wrapped(signal, raw: float) -> float:  # type: ignore[no-untyped-def]
    """A raw position as a counter of this signal's width shows it."""
    if signal.conversion.is_float:
        return raw
    span = 1 << int(signal.length)
    number = math.floor(raw) % span
    return number - span if signal.is_signed and number >= span // 2 else number


def clipped(signal, raw: float) -> float:  # type: ignore[no-untyped-def]
    """The nearest raw value that this signal can say and that does not mean "not available"."""
    if signal.conversion.is_float:
        return raw
    most = (1 << int(signal.length) - bool(signal.is_signed)) - (2 if signal.length >= SENTINEL_BITS else 1)
    low, high = raw_limits(signal) or (-most, most)
    return max(-most if signal.is_signed else 0, math.ceil(low), min(most, math.floor(high), round(raw)))
