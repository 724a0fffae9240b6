"""Which layout the configuration names, and the decoder made from it."""

from collections.abc import Iterator
from pathlib import Path

from cantools.database.can import Message

from drivers.settings.encoders import EncoderSettings
from drivers.settings.layouts import Cia406Layout, DbcLayout, Layout, PresetLayout, SignalsLayout
from drivers.settings.wheel_signals import WheelSignals
from drivers.wheels.layouts.dbc_file import dbc_messages
from drivers.wheels.layouts.direction import is_own_direction
from drivers.wheels.layouts.presets import preset_layout
from drivers.wheels.layouts.routes import built_message, decoder_of, refuse_duplicate_ids
from drivers.wheels.readings import WheelDecoder

ROVER_DBC = Path(__file__).with_name("infant.dbc")


def wheel_decoder(settings: EncoderSettings) -> WheelDecoder:
    """The decoder that the settings describe. Raises DriverError with one sentence."""
    layout = settings.layout
    if isinstance(layout, Cia406Layout):
        from drivers.wheels.layouts.cia406 import cia406_decoder  # the extra canopen is needed only here

        return cia406_decoder(layout, settings)
    return decoder_of(*described_wheels(layout), settings)


def described_wheels(layout: Layout) -> tuple[dict[str, Message], WheelSignals, WheelSignals]:
    """Messages by name, and what the left and the right wheel say in them: one description for both directions.

    Raises DriverError with one sentence.
    """
    if isinstance(layout, Cia406Layout):
        from drivers.wheels.layouts.cia406 import cia406_messages

        return cia406_messages(layout)
    described = preset_layout(layout) if isinstance(layout, PresetLayout) else layout
    return layout_messages(described), described.left, described.right


def layout_messages(layout: DbcLayout | SignalsLayout) -> dict[str, Message]:
    """Messages by name, each id once; of a DBC those that the wheels name."""
    if isinstance(layout, DbcLayout):
        path = ROVER_DBC if layout.file is None else Path(layout.file)
        return dbc_messages(path, _named(layout), _read_signals(layout))
    messages = {message.name: built_message(message) for message in layout.messages}
    refuse_duplicate_ids("messages", [(message.frame_id, message.name) for message in layout.messages])
    return messages


def _named(layout: DbcLayout) -> Iterator[str]:
    for wheel in (layout.left, layout.right):
        yield wheel.message
        if wheel.info is not None:
            yield wheel.info.message
        if not is_own_direction(wheel) and wheel.direction:
            yield wheel.direction.rpartition(".")[0]


def _read_signals(layout: DbcLayout) -> set[str]:
    """Every word of the layout that may be the name of a signal."""
    tables = [part for wheel in (layout.left, layout.right) for part in (wheel, wheel.info) if part is not None]
    words = {value for part in tables for value in part.model_dump().values() if isinstance(value, str)}
    return words | {word.rpartition(".")[2] for word in words}
