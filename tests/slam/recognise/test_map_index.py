import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.measurements import FloatArray, IntArray
from runtime.studies.recognition.constellations import SCALE, scattered
from slam.recognise import map_index
from slam.recognise.grid import NONE, make_grid, nearest
from slam.recognise.map_index import MapIndex, MapPairs, index_of
from tests.support.examples import examples
from tests.support.slam.python_calls import calls_in


def content(index: MapIndex) -> tuple[set[tuple[int, int, float]], dict[int, tuple[float, ...]], float]:
    """What an index holds, without the rows that it happens to hold it in."""
    indexed = index.indexed
    first, second = indexed.identities[indexed.pairs.first], indexed.identities[indexed.pairs.second]
    ends = zip(np.minimum(first, second).tolist(), np.maximum(first, second).tolist(), strict=True)
    pairs = {(*end, length) for end, length in zip(ends, indexed.pairs.lengths_m.tolist(), strict=True)}
    assert len(pairs) == len(indexed.pairs.lengths_m)
    assert (np.diff(indexed.pairs.lengths_m) >= 0.0).all()
    used = np.flatnonzero(indexed.identities >= 0).tolist()
    rows = {
        int(indexed.identities[row]): (*indexed.grid.points_m[row].tolist(), float(indexed.densities[row]))
        for row in used
    }
    return pairs, rows, indexed.area_m2


def landmarks(seed: int, count: int) -> tuple[IntArray, FloatArray]:
    generator = np.random.default_rng(seed)
    return generator.permutation(4 * count)[:count], scattered(generator, count)


@examples(25)
@given(st.integers(0, 2**31), st.integers(1, 7))
def test_an_index_that_follows_a_map_is_the_index_made_at_once(seed: int, most_changes: int) -> None:
    generator = np.random.default_rng(seed)
    identities, means = landmarks(seed, 60)
    index = MapIndex(SCALE)
    index.follow(identities[:40], means[:40])
    means = means + 3.0 * (generator.random((60, 1)) < 0.3)
    kept = generator.random(60) < 0.8
    calls = 1
    while not index.follow(identities[kept], means[kept], most_changes):
        calls += 1
    assert calls >= 20 // most_changes
    assert content(index) == content(index_of(SCALE, identities[kept], means[kept]))


def test_a_landmark_that_moved_by_little_stays_where_it_is() -> None:
    identities, means = landmarks(1, 50)
    index = index_of(SCALE, identities, means)
    before = index.indexed
    assert index.follow(identities, means + 0.01)
    assert index.indexed is before


def test_a_map_is_followed_in_as_many_calls_whatever_it_holds() -> None:
    """Of 20 000 landmarks it took 20 ms, every ten scans, while the loop waited."""

    def calls(count: int) -> int:
        identities, means = landmarks(1, count)
        index = index_of(SCALE, identities, means)
        return calls_in(lambda: index.follow(identities, means))

    assert calls(600) == calls(60)


def test_two_landmarks_of_one_name_are_followed_as_one() -> None:
    """A sensor that names some of its landmarks may say a number that the map has given; each later scan failed."""
    identities, means = landmarks(7, 40)
    identities[1] = identities[0]
    index = MapIndex(SCALE)
    for _ in range(3):
        index.follow(identities, means)
    index.follow(identities[2:], means[2:])
    assert content(index) == content(index_of(SCALE, identities[2:], means[2:]))


def test_pairs_beyond_the_bound_shorten_the_longest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(map_index, "MOST_PAIRS", 300)
    index = index_of(SCALE, *landmarks(2, 120))
    lengths = index.indexed.pairs.lengths_m
    assert 100 < len(lengths) <= 300
    assert lengths.min() >= SCALE.shortest_pair_m


def test_pairs_of_a_crowded_map_never_fill_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """10 000 landmarks within 20 m took 5 GB: all their pairs were found before the longest were left out."""
    monkeypatch.setattr(map_index, "MOST_PAIRS", 1000)
    monkeypatch.setattr(map_index, "MOST_COMING", 10**9)
    identities, means = np.arange(400), np.random.default_rng(3).uniform(-10.0, 10.0, (400, 2))
    at_once = content(index_of(SCALE, identities, means))
    monkeypatch.setattr(map_index, "MOST_COMING", 500)
    coming: list[int] = []
    merged = map_index._merged

    def watched(pairs: MapPairs, lengths_m: FloatArray, first: IntArray, second: IntArray) -> MapPairs:
        coming.append(len(lengths_m))
        return merged(pairs, lengths_m, first, second)

    monkeypatch.setattr(map_index, "_merged", watched)
    assert content(index_of(SCALE, identities, means)) == at_once
    assert max(coming) < 500 + 400


@examples(50)
@given(st.integers(0, 2**31), st.floats(0.1, 3.0))
def test_the_grid_finds_the_nearest_point(seed: int, gate_m: float) -> None:
    generator = np.random.default_rng(seed)
    points, used = generator.uniform(-20.0, 20.0, (60, 2)), generator.random(60) < 0.8
    grid = make_grid(points, used, 1.3)
    for x, y in generator.uniform(-22.0, 22.0, (20, 2)):
        distances = np.where(used, np.hypot(points[:, 0] - x, points[:, 1] - y), np.inf)
        best = int(np.argmin(distances))
        found, square = nearest(grid, x, y, gate_m)
        assert found == (best if distances[best] < gate_m else NONE)
        assert found == NONE or np.isclose(square, distances[best] ** 2)
