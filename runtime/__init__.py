"""What happens around the method: time, record, replay, network, configuration, command line? Begin at live/loop.py
for the rover, at replay/replay.py for a recorded run.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from runtime.api.arrays import ticks_from_arrays
    from runtime.api.run import Run, open_run
    from runtime.api.trajectory import Trajectory
    from runtime.record.reader import RunReader
    from runtime.settings.configuration import Configuration, load_configuration
    from runtime.tick import Tick

__all__ = [
    "Configuration",
    "Run",
    "RunReader",
    "Tick",
    "Trajectory",
    "load_configuration",
    "open_run",
    "ticks_from_arrays",
]

HOMES = {
    "Run": "runtime.api.run",
    "Tick": "runtime.tick",
    "Trajectory": "runtime.api.trajectory",
    "open_run": "runtime.api.run",
    "ticks_from_arrays": "runtime.api.arrays",
    "Configuration": "runtime.settings.configuration",
    "load_configuration": "runtime.settings.configuration",
    "RunReader": "runtime.record.reader",
}


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first asked for (PEP 562). Raises AttributeError for any other."""
    if name not in HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(HOMES[name]), name)
