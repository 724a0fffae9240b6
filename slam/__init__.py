"""How does a scan and the motion of two wheels become a pose? Pure arrays: no clock, no thread, no socket; begin at
estimator.py, whose `Estimator.step` reads like the paper.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from slam.estimate import Estimate
    from slam.estimator import Estimator
    from slam.pose import Pose2
    from slam.settings.slam import SlamSettings

__all__ = ["Estimate", "Estimator", "Pose2", "SlamSettings"]

HOMES = {
    "Estimate": "slam.estimate",
    "Estimator": "slam.estimator",
    "Pose2": "slam.pose",
    "SlamSettings": "slam.settings.slam",
}


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first asked for (PEP 562). Raises AttributeError for any other."""
    if name not in HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(HOMES[name]), name)
