"""How the landmarks at the end of a run differ from those of the map that it began in."""

from dataclasses import dataclass

import numpy as np

from drivers.measurements import FloatArray
from runtime.map_files.confirmed import CONFIRMED_LOG_ODDS
from slam.estimate import LandmarkMap
from slam.settings.tuning import Tuning

GONE_LOG_ODDS: float = Tuning._field_defaults["log_odds_remove"]  # as the filter removes a landmark of its own


@dataclass(frozen=True, slots=True, eq=False)
class MapChanges:
    """Places (n, 2) in the map frame: of what should have been seen and was not, and of what was not there before."""

    gone_m: FloatArray
    new_m: FloatArray


def map_changes(known: LandmarkMap, now: LandmarkMap) -> MapChanges:
    """known: the saved map; now: what the run published last, whose log-odds are those of this drive as well."""
    standing = now.identities[now.existence_log_odds > GONE_LOG_ODDS]
    gone = ~np.isin(known.identities, standing)
    new = ~np.isin(now.identities, known.identities) & (now.existence_log_odds >= CONFIRMED_LOG_ODDS)
    return MapChanges(known.means_m[gone], now.means_m[new])
