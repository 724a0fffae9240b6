"""The characters of a simulated scan: clusters, intensities and further echoes for any request."""

import numpy as np
from numpy.typing import NDArray

from drivers.scip.commands import ScanRequest
from drivers.scip.scan import ECHO_MARK, CodeArray, encode_characters

SHORT_RANGE_MAX = 4095  # two characters (MS, GS) saturate here
FULL_INTENSITY = 16000.0  # near the largest value in the recorded UTM-30LX scan
HALF_INTENSITY_MM = 3000.0
EDGE_MM = 500  # two surfaces so far apart under one beam give two echoes


def scan_characters(request: ScanRequest, codes: CodeArray, range_min_mm: int) -> bytes:
    """Encoded data of one scan from the codes (steps,) inside the window of the request."""
    nearest = clustered(codes, max(1, request.cluster), range_min_mm)
    if not request.is_multi_echo:
        return _values(request, nearest, range_min_mm).tobytes()
    # a beam that grazes an edge meets both surfaces
    behind = np.append(nearest[1:], nearest[-1])
    is_double = (nearest >= range_min_mm) & (behind > nearest + EDGE_MM)
    first, second = _values(request, nearest, range_min_mm), _values(request, behind, range_min_mm)
    mark = np.full((1,), ECHO_MARK, np.uint8)
    pieces = [
        np.concatenate((one, mark, other)) if double else one
        for one, other, double in zip(first, second, is_double, strict=True)
    ]
    return np.concatenate(pieces).tobytes()


def clustered(codes: CodeArray, cluster: int, range_min_mm: int) -> CodeArray:
    """The smallest range of each `cluster` steps; an error code only where none of them has a range."""
    if cluster == 1:
        return codes
    padding = -len(codes) % cluster
    table = np.pad(codes, (0, padding), mode="edge").reshape(-1, cluster)
    ranges = np.where(table < range_min_mm, np.iinfo(np.int32).max, table)
    best: CodeArray = ranges.min(axis=1)
    return np.where(best == np.iinfo(np.int32).max, table[:, 0], best).astype(np.int32)


def _values(request: ScanRequest, codes: CodeArray, range_min_mm: int) -> NDArray[np.uint8]:
    """Characters (values, width)."""
    if request.range_characters == 2:
        return encode_characters(np.minimum(codes, SHORT_RANGE_MAX), 2)
    characters = encode_characters(codes, 3)
    if not request.has_intensity:
        return characters
    intensity = np.where(codes >= range_min_mm, FULL_INTENSITY / (1.0 + codes / HALF_INTENSITY_MM), 0.0)
    return np.concatenate((characters, encode_characters(intensity.astype(np.int32), 3)), axis=1)
