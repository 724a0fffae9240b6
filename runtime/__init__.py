"""What happens around the method: time, record, replay, network, configuration, command line? Begin at live/loop.py
for the rover, at replay/replay.py for a recorded run.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from runtime.record.reader import RunReader
    from runtime.settings.configuration import Configuration, load_configuration

__all__ = ["Configuration", "RunReader", "load_configuration"]

HOMES = {
    "Configuration": "runtime.settings.configuration",
    "load_configuration": "runtime.settings.configuration",
    "RunReader": "runtime.record.reader",
}


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first asked for (PEP 562). Raises AttributeError for any other."""
    if name not in HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(HOMES[name]), name)
