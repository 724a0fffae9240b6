"""Maps in which the rover is not: its scans are laid onto those of other buildings, and onto its own in the mirror."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from drivers.measurements import FloatArray
from runtime.studies.jobs import Result
from runtime.studies.relocalisation.told_drives import recorded
from slam.relocalise.local_map import ScanSeen
from slam.scan_search.agreement import Agreement
from slam.scan_search.ground import Ground, ground_of
from slam.scan_search.laying import Laid, Laying
from slam.scan_search.stretch import Stretch

MAPPED = (0.95,)  # share of a recording that makes its map
FORTH, MIRRORED = np.ones(3), np.array((1.0, -1.0, -1.0))
SET_DOWN = 120  # scans, after which the rover is set down anew
WHOLE = 10**12  # cells looked up: an attempt at once


def stranger_trial(
    data: str,
    driven: str,
    maps: Sequence[str],
    code: str,  # noqa: ARG001  names the job
) -> Result:
    """attempts; believed: how many of them were; odds: the largest of one stretch, agreed: of some that agree."""
    seen = recorded(data, driven, MAPPED).seen
    attempts, believed, odds, agreed = 0, 0, -math.inf, 0.0
    for name in maps:
        (known,) = recorded(data, name, MAPPED).maps.values()
        ground = ground_of(known.views)
        for begin in range(0, len(seen), SET_DOWN):
            agreement = Agreement()
            scans = seen[begin : begin + SET_DOWN]
            for laid, stretch in attempts_of(ground, scans, MIRRORED if name == driven else FORTH):
                attempts += 1
                believed += agreement.add(laid, stretch.frame_from_body) is not None
                odds, agreed = max(odds, laid.odds), max(agreed, agreement.odds)
    result = {"drive": driven, "maps": len(maps), "attempts": attempts, "believed": believed}
    return result | {"odds": round(odds, 1), "agreed": round(agreed, 1)}


def attempts_of(ground: Ground, scans: Sequence[ScanSeen], sides: FloatArray) -> Iterator[tuple[Laid, Stretch]]:
    """Every stretch of a way laid onto a map. sides (3,): 1, or -1 where the way is mirrored."""
    stretch = Stretch()
    for scan in scans:
        stretch.add(scan.increment_mean * sides, (scan.points_m * sides[:2]).astype(np.float32))
        if stretch.is_due:
            laid = Laying(ground, stretch.take()).advance(WHOLE)
            if laid is not None:
                yield laid, stretch
