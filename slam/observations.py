"""What a front end hands to the filter: point features of one scan, in the laser's frame."""

from dataclasses import dataclass
from enum import IntEnum

from drivers.measurements import BoolArray, FloatArray, IntArray


class BeamVerdict(IntEnum):
    """What the front end thought of one beam; recorded so that a reviewer sees why a point was not used."""

    KEPT = 0
    NO_RETURN = 1
    MOVED = 2
    NOT_COMPARED = 3


class MatchVerdict(IntEnum):
    """What became of one feature in the best particle; a match is the landmark's identity, 0 or more."""

    NEW = -1
    UNLICENSED = -2
    AMBIGUOUS = -3
    EXCLUDED = -4
    OUT_OF_RANGE = -5


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Point features of one scan, already corrected for the rover's motion during the sweep.

    ranges_m, bearings_rad: (K,) in the laser's frame at stamp_ns.
    covariances: (K, 2, 2) of (range, bearing).
    may_create: (K,) True where difference or vote licenses a new landmark; any feature may match.
    identities: (K,) -1 where unknown.
    beams: (K,) index of the beam nearest the feature, -1 where there is none.
    """

    stamp_ns: int
    ranges_m: FloatArray
    bearings_rad: FloatArray
    covariances: FloatArray
    may_create: BoolArray
    identities: IntArray
    beams: IntArray

    def __len__(self) -> int:
        return int(self.ranges_m.shape[0])
