"""An occupancy grid in the files that nav2's map_server reads: a picture in PGM and its description in YAML."""

import numpy as np

from slam.maps.occupancy_grid import FREE, OCCUPIED, GridMap

GREY_OCCUPIED, GREY_UNKNOWN, GREY_FREE = 0, 205, 254  # as nav2's map_saver writes them
OCCUPIED_THRESHOLD = 0.65
FREE_THRESHOLD = 0.196  # 205 is unknown by a hair: nav2's own 0.25 would make it free in the mode "trinary"


def pgm(grid: GridMap) -> bytes:
    """Binary PGM; the first line of the picture is the highest y."""
    greys = np.full(grid.occupancy.shape, GREY_UNKNOWN, dtype=np.uint8)
    greys[grid.occupancy == FREE] = GREY_FREE
    greys[grid.occupancy == OCCUPIED] = GREY_OCCUPIED
    rows, columns = grid.occupancy.shape
    return f"P5\n{columns} {rows}\n255\n".encode() + greys[::-1].tobytes()


def map_server_yaml(grid: GridMap, picture: str) -> str:
    """The description of the picture with this file name."""
    x_m, y_m = grid.origin_m
    return (
        f"image: {picture}\n"
        "mode: trinary\n"
        f"resolution: {grid.resolution_m:g}\n"
        f"origin: [{x_m:.6g}, {y_m:.6g}, 0]\n"
        "negate: 0\n"
        f"occupied_thresh: {OCCUPIED_THRESHOLD}\n"
        f"free_thresh: {FREE_THRESHOLD}\n"
    )
