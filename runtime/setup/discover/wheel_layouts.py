"""Which layouts that Infant knows fit what is heard on the bus."""

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.settings.layouts import Cia406Layout, DbcLayout, Layout, PresetLayout
from runtime.setup.discover.can_traffic import IdTraffic

INFANT_IDS = (0x181, 0x182)
LEAST_HZ = 5.0  # of a message that carries a position


@dataclass(frozen=True, slots=True)
class LayoutFound:
    """A layout that fits. name: of the controller; rate_hz: of its position; why: what was heard."""

    name: str
    layout: Layout
    rate_hz: float
    why: str


def layouts_that_fit(traffic: Sequence[IdTraffic]) -> list[LayoutFound]:
    """The surest first. The lower of two node numbers is taken for the left wheel."""
    fast = [each for each in traffic if (each.rate_hz or 0.0) >= LEAST_HZ]
    found = [*_infant(fast)]
    found += _preset("odrive", "ODrive", [each for each in fast if _is(each, False, 0x1F, 0x09, 8)], 5)
    found += _preset("odrive_counts", "ODrive counts", [each for each in fast if _is(each, False, 0x1F, 0x0A, 8)], 5)
    found += _preset("vesc", "VESC", [each for each in fast if each.extended and each.number >> 8 == 27], 0, 0xFF)
    tpdo = [each for each in fast if not each.extended and 0x181 <= each.number <= 0x1FF and not _is_infant(each)]
    heartbeats = {each.number & 0x7F for each in traffic if 0x701 <= each.number <= 0x77F and each.length == 1}
    found += _preset("cia402", "CiA 402", [each for each in tpdo if each.length == 6], 0, 0x7F)
    encoders = [each for each in tpdo if each.length != 6 and each.length >= 4 and each.number & 0x7F in heartbeats]
    if len(encoders) == 2:
        nodes = [each.number & 0x7F for each in encoders]
        layout = Cia406Layout(kind="cia406", left_node=nodes[0], right_node=nodes[1])
        found.append(LayoutFound("CiA 406", layout, _rate(encoders), f"{_names(encoders)} with heartbeats"))
    return found


def _is(each: IdTraffic, extended: bool, mask: int, command: int, length: int) -> bool:
    return each.extended == extended and each.number & mask == command and each.length == length


def _is_infant(each: IdTraffic) -> bool:
    return each.number in INFANT_IDS and not each.extended and each.length == 8 and "SAE J1850 over id" in each.crc


def _infant(fast: Sequence[IdTraffic]) -> list[LayoutFound]:
    own = [each for each in fast if _is_infant(each)]
    if len(own) != 2:
        return []
    return [LayoutFound("Infant", DbcLayout(), _rate(own), f"{_names(own)} with the checksum of Infant's own nodes")]


def _preset(name: str, maker: str, fit: Sequence[IdTraffic], shift: int, mask: int = 0x3F) -> list[LayoutFound]:
    """Two nodes that send what the preset describes; one, or three, are not a rover's wheels."""
    if len(fit) != 2:
        return []
    nodes = [each.number >> shift & mask for each in fit]
    layout = PresetLayout.model_validate(
        {"kind": "preset", "name": name, "left_node": nodes[0], "right_node": nodes[1]}
    )
    why = f"{_names(fit)}, the position messages of nodes {nodes[0]} and {nodes[1]}"
    return [LayoutFound(maker, layout, _rate(fit), why)]


def _rate(found: Sequence[IdTraffic]) -> float:
    return min(each.rate_hz or 0.0 for each in found)


def _names(found: Sequence[IdTraffic]) -> str:
    return " and ".join(each.name for each in found)
