"""DBC files as small as they can be, and the wheels that read them."""

import itertools
from pathlib import Path
from typing import Any

from drivers.canbus.frame import CanFrame
from drivers.measurements import WheelCounts
from drivers.settings.encoders import EncoderSettings
from drivers.wheels.layouts.choose import wheel_decoder
from drivers.wheels.pair import WheelPair

HEAD = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: A B\n\n'
BEAT_NS = 20_000_000


def message(number: int, name: str, *signals: str) -> str:
    """A message of eight bytes; signals as "NAME : 0|32@1- (1,0) [0|0]"."""
    lines = "".join(f' SG_ {signal} "" B\n' for signal in signals)
    return f"BO_ {number} {name}: 8 A\n{lines}"


COUNTS = HEAD + "".join(message(512 + k, name, "Cnt : 0|32@1- (1,0) [0|0]") for k, name in enumerate(("LW", "RW")))


def wheels(tmp_path: Path, text: str | bytes, left: dict[str, Any], right: dict[str, Any], **more: Any) -> WheelPair:
    """Both wheels of a layout in this DBC."""
    path = tmp_path / "wheels.dbc"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    layout = {"kind": "dbc", "file": str(path), "left": left, "right": right}
    settings = EncoderSettings.model_validate({"layout": layout, **more})
    return WheelPair(settings, wheel_decoder(settings))


def plain(tmp_path: Path, text: str | bytes = COUNTS) -> WheelPair:
    """Both wheels of a DBC with a count in LW and in RW."""
    return wheels(tmp_path, text, {"message": "LW", "count": "Cnt"}, {"message": "RW", "count": "Cnt"})


def feed(pair: WheelPair, beat: int, number: int, data: bytes) -> None:
    """One frame, the second wheel's a millisecond after the first's."""
    pair.feed(CanFrame(beat * BEAT_NS + number % 2 * 1_000_000, number, data.ljust(8, b"\0")))


def turned_counts(samples: tuple[WheelCounts, ...]) -> float:
    """How many counts the right wheel is said to have gained on the left one, over samples that claim to know it."""
    gained = 0.0
    for before, after in itertools.pairwise(samples):
        if after.valid and (before.valid or after.unbroken):
            gained += (after.right - before.right) - (after.left - before.left)
    return gained
