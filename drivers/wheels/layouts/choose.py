"""Which layout the configuration names, and the decoder made from it."""

import re
from pathlib import Path

from cantools.database.can import Database, Message

from drivers.measurements import DriverError
from drivers.settings.encoders import EncoderSettings
from drivers.settings.layouts import Cia406Layout, DbcLayout, PresetLayout, SignalsLayout
from drivers.wheels.layouts.presets import preset_layout
from drivers.wheels.layouts.routes import built_message, decoder_of, refuse_duplicate_ids
from drivers.wheels.readings import WheelDecoder

ROVER_DBC = Path(__file__).with_name("infant.dbc")
BO_LINE = re.compile(r"^BO_\s+(\d+)\s+(\w+)", re.MULTILINE)


def wheel_decoder(settings: EncoderSettings) -> WheelDecoder:
    """The decoder that the settings describe. Raises DriverError with one sentence."""
    layout = settings.layout
    if isinstance(layout, Cia406Layout):
        from drivers.wheels.layouts.cia406 import cia406_decoder  # the extra canopen is needed only here

        return cia406_decoder(layout, settings)
    described = preset_layout(layout) if isinstance(layout, PresetLayout) else layout
    return decoder_of(layout_messages(described), described.left, described.right, settings)


def layout_messages(layout: DbcLayout | SignalsLayout) -> dict[str, Message]:
    """Messages by name, each id once."""
    if isinstance(layout, DbcLayout):
        return dbc_messages(ROVER_DBC if layout.file is None else Path(layout.file))
    messages = {message.name: built_message(message) for message in layout.messages}
    refuse_duplicate_ids("messages", [(message.frame_id, message.name) for message in layout.messages])
    return messages


def dbc_messages(path: Path) -> dict[str, Message]:
    """Messages of a DBC; refuses duplicate ids (of which cantools keeps the last) and overlapping signals."""
    try:
        text = path.read_text(encoding="cp1252")  # as cantools reads it
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not text"
        raise DriverError(f"{path}: cannot be read ({reason}); give the path of a DBC in layout.file") from error
    refuse_duplicate_ids(str(path), [(int(number), name) for number, name in BO_LINE.findall(text)])
    try:
        database = Database(strict=True)
        database.add_dbc_string(text)
    except Exception as error:  # cantools lets those of its parser through, which has a family of its own
        raise DriverError(f"{path}: not a DBC that can be used ({error}); mend the file or name another") from error
    return {message.name: message for message in database.messages}
