"""The configuration that setup writes: some twenty lines, each with what it is and who can say better."""

import json
import math
from dataclasses import dataclass

from drivers.settings.can import BusSettings
from drivers.settings.layouts import Cia406Layout, PresetLayout
from drivers.settings.wheel_signals import WheelSignals
from runtime.setup.discover.listen import LaserFound
from runtime.setup.discover.wheel_layouts import LayoutFound


@dataclass(frozen=True, slots=True)
class Geometry:
    """What nobody can hear on a wire; metres. laser_ahead_m: from the middle of the wheels' axle. reversed_wheels:
    "left" and "right", whose counts fall when the rover drives forward.
    """

    wheel_radius_m: float
    tread_m: float
    counts_per_rev: float
    laser_ahead_m: float
    laser_backwards: bool = False
    laser_upside_down: bool = False
    reversed_wheels: tuple[str, ...] = ()


def configuration_text(
    name: str | None, laser: LaserFound, bus: BusSettings, wheels: LayoutFound, geometry: Geometry
) -> str:
    """TOML, with comments. name: None leaves it to the machine, whose name no second rover has."""
    yaw = "3.141592653589793" if geometry.laser_backwards else "0.0"
    lines = [
        "# Written by infant setup. `infant config --explain KEY` says what a key means and how to find its value.",
        *(() if name is None else (f"rover = {json.dumps(name)}",)),
        "",
        "[laser]",
        f"url = {json.dumps(laser.url)}  # {laser.model}, serial number {laser.serial_number}",
        "",
        "[vehicle]  # by ruler and data sheet; infant calibrate corrects radii and tread",
        f"wheel_radius_left_m = {geometry.wheel_radius_m!r}",
        f"wheel_radius_right_m = {geometry.wheel_radius_m!r}",
        f"tread_m = {geometry.tread_m!r}  # between the points where the wheels touch the ground",
        f"counts_per_rev = {geometry.counts_per_rev!r}  # for one turn of the wheel, gear included",
        "",
        "[slam.mount]  # infant calibrate corrects it",
        f"x_m = {geometry.laser_ahead_m!r}  # laser ahead of the middle of the wheels' axle",
        f"yaw_rad = {yaw}",
        f"upside_down = {str(geometry.laser_upside_down).lower()}",
        "",
        "[encoders]",
        f"period_ms = {round(1000.0 / wheels.rate_hz, 1)!r}  # between two frames of one wheel, as heard",
        "",
        *_signs(geometry),
        "[encoders.bus]",
        f"interface = {json.dumps(bus.interface)}",
        f"channel = {json.dumps(bus.channel)}",
        *([f"port = {bus.port}"] if bus.port else []),
        "",
        *_layout_lines(wheels, geometry),
    ]
    return "\n".join(lines) + "\n"


def _signs(geometry: Geometry) -> list[str]:
    """Tables of the wheels that count backwards."""
    line = "sign = -1  # its count falls when the rover drives forward"
    return [word for side in geometry.reversed_wheels for word in (f"[encoders.{side}]", line, "")]


def _layout_lines(wheels: LayoutFound, geometry: Geometry) -> list[str]:
    layout = wheels.layout
    head = f"[encoders.layout]  # {wheels.name}, recognised by {wheels.why}"
    if isinstance(layout, PresetLayout):
        words = ['kind = "preset"', f"name = {json.dumps(layout.name)}"]
    elif isinstance(layout, Cia406Layout):
        words = ['kind = "cia406"']
    elif layout.file is None:
        return [head, 'kind = "dbc"  # Infant\'s own nodes']
    else:
        sides = (("left", layout.left), ("right", layout.right))
        return [head, 'kind = "dbc"', f"file = {json.dumps(layout.file)}", *(_side(*side, geometry) for side in sides)]
    return [
        head,
        *words,
        f"left_node = {layout.left_node}  # swap both if the rover turns left and the pose turns right",
        f"right_node = {layout.right_node}",
    ]


def _side(name: str, signals: WheelSignals, geometry: Geometry) -> str:
    """One wheel's signals in a line."""
    if signals.tells_metres:
        counts_per_metre = geometry.counts_per_rev / (2.0 * math.pi * geometry.wheel_radius_m)
        signals = signals.model_copy(update={"counts_per_unit": round(counts_per_metre, 6)})
    words = (f"{key} = {json.dumps(value)}" for key, value in signals.model_dump(exclude_defaults=True).items())
    return f"{name} = {{ {', '.join(words)} }}"
