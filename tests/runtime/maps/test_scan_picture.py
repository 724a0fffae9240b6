import io
from base64 import b64decode

import numpy as np
from PIL import Image

from runtime.maps.scan_picture import APART_NS, CELL_M, MOST_PIXELS, ScanCells, ScanPicture


def _pixels(picture: ScanPicture) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(b64decode(picture.url.partition(",")[2]))).convert("RGBA"))


def test_a_point_is_where_the_map_has_it_and_darker_the_oftener_it_was_seen() -> None:
    cells = ScanCells()
    for turn in range(3):
        cells.take(turn * APART_NS, np.array(((-1.05, 2.05),)))
    cells.take(3 * APART_NS, np.array(((1.05, -0.95),)))
    picture = cells.picture()
    assert picture is not None
    pixels = _pixels(picture)
    often, once = pixels[0, 0, 3], pixels[-1, -1, 3]  # upper left and lower right
    assert often > once > 0
    assert np.count_nonzero(pixels[..., 3]) == 2
    assert np.isclose(picture.x_m, -1.1)
    assert np.isclose(picture.y_m, -1.0)
    assert np.isclose(picture.width_m, pixels.shape[1] * CELL_M)


def test_a_place_of_kilometres_has_larger_cells() -> None:
    cells = ScanCells()
    cells.take(0, np.array(((0.0, 0.0), (5000.0, 100.0))))
    picture = cells.picture()
    assert picture is not None
    assert max(_pixels(picture).shape[:2]) <= MOST_PIXELS
    assert picture.width_m >= 5000.0


def test_scans_are_taken_with_pauses_and_none_gives_no_picture() -> None:
    cells = ScanCells()
    assert cells.picture() is None
    assert cells.wants(0)
    cells.take(0, np.zeros((1, 2)))
    assert not cells.wants(APART_NS - 1)
    assert cells.wants(APART_NS)
