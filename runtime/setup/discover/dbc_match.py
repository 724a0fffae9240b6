"""A DBC at hand, tried against what is heard: signals of the left and the right wheel in messages that come."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cantools

from drivers.measurements import DriverError
from drivers.settings.layouts import DbcLayout
from drivers.settings.wheel_signals import SpeedUnit, WheelSignals
from drivers.wheels.layouts.dbc_file import dbc_text
from runtime.setup.discover.can_traffic import IdTraffic
from runtime.setup.discover.wheel_layouts import LEAST_HZ, LayoutFound

SIDES = (
    ("RL", "RR"),
    ("Left", "Right"),
    ("LEFT", "RIGHT"),
    ("left", "right"),
    ("_L", "_R"),
    ("L_", "R_"),
    ("FL", "FR"),
)
UNITS: dict[str, SpeedUnit] = {
    "km/h": "kph",
    "kph": "kph",
    "kmh": "kph",
    "m/s": "mps",
    "mps": "mps",
    "rpm": "rpm",
    "1/min": "rpm",
    "rev/s": "turns_per_s",
}
COUNTED = ("count", "tick", "pos", "pulse", "enc")


def layouts_in(path: Path, traffic: Sequence[IdTraffic]) -> list[LayoutFound]:
    """Layouts of this DBC whose messages are heard: counts before speeds, the rear axle before others.

    Raises DriverError where the file is no DBC.
    """
    text = dbc_text(path)
    try:
        database: Any = cantools.database.load_string(text, "dbc", strict=False)
        messages = list(database.messages)
    except Exception as error:  # its parser raises what it likes
        reason = " ".join(str(error).split())[:200]
        raise DriverError(f"{path}: not a usable DBC ({reason}); give another with --dbc") from error
    heard = {(each.number, each.extended): each for each in traffic if (each.rate_hz or 0.0) >= LEAST_HZ}
    come = [(m, heard[m.frame_id, m.is_extended_frame]) for m in messages if (m.frame_id, m.is_extended_frame) in heard]
    signals = {(m.name, s.name): (s, found) for m, found in come for s in m.signals}
    pairs = (_layout(path, signals, left, right) for left, right in _pairs(signals))
    return sorted((each for each in pairs if each is not None), key=lambda each: _rank(each.layout))


def _pairs(signals: dict[tuple[str, str], Any]) -> Iterator[tuple[tuple[str, str], tuple[str, str]]]:
    """Names (message, signal) that differ in nothing but the side."""
    seen = set()
    for message, signal in signals:
        for left, right in SIDES:
            other = (message.replace(left, right), signal.replace(left, right))
            for pair in ((message, other[1]), other):
                if pair in signals and signal != pair[1] and (message, signal, pair) not in seen:
                    seen.add((message, signal, pair))
                    yield (message, signal), pair


def _layout(
    path: Path, signals: dict[tuple[str, str], Any], left: tuple[str, str], right: tuple[str, str]
) -> LayoutFound | None:
    signal, traffic = signals[left]
    unit = UNITS.get((signal.unit or "").strip().lower())
    if unit is None and not any(word in left[1].lower() for word in COUNTED):
        return None
    told = {"speed_unit": unit} if unit is not None else {}
    sides = [
        WheelSignals.model_validate({"message": message, ("speed" if unit else "count"): name} | told)
        for message, name in (left, right)
    ]
    layout = DbcLayout(file=str(path.resolve()), left=sides[0], right=sides[1])
    why = f"{traffic.name} as {path.name} describes it: {left[1]} and {right[1]}"
    return LayoutFound(f"DBC {path.name}", layout, traffic.rate_hz or 0.0, why)


def _rank(layout: Any) -> tuple[bool, bool]:
    return not layout.left.count, "RL" not in layout.left.speed + layout.left.count
