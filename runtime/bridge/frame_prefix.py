"""Names of frames in a message behind a rover's prefix; without a prefix its bytes stay as they are."""

from typing import Any

from runtime.messages.definitions import deserialize, serialize
from runtime.ros2.vehicle import Frames


def with_prefix(type_name: str, data: bytes, frames: Frames) -> bytes:
    """The message with its frames renamed. Raises ValueError where the data is none of its type."""
    if not frames.prefix:
        return data
    message = deserialize(type_name, data)
    _rename(message, frames)
    return serialize(type_name, message)


def _rename(message: Any, frames: Frames) -> None:
    if hasattr(message, "header") and message.header.frame_id:
        message.header.frame_id = frames(message.header.frame_id)
    if hasattr(message, "child_frame_id"):
        message.child_frame_id = frames(message.child_frame_id)
    for name in ("transforms", "markers", "poses"):
        for part in getattr(message, name, ()):
            _rename(part, frames)
