"""Maps in shared pages: no particle ever sees another's writes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.particles.pages import (
    FREE_PAGES,
    LOG_ODDS,
    NONE,
    PAGE_LANDMARKS,
    USED_SLOTS,
    X,
    append,
    remove_below,
    writable,
)
from slam.particles.resampling import adopt_maps
from slam.particles.store import LandmarkStore
from tests.support.examples import examples

PARTICLES = 4
Book = dict[int, tuple[float, ...]]


def landmark(x: float, y: float, log_odds: float = 1.0) -> np.ndarray:
    return np.array((x, y, 0.1, 0.0, 0.2, log_odds))


def map_of(store: LandmarkStore, particle: int) -> Book:
    identities, numbers = store.rows_of(particle)
    return {int(identity): tuple(row) for identity, row in zip(identities, numbers, strict=True)}


def put(store: LandmarkStore, particle: int, numbers: np.ndarray, identity: int) -> None:
    store.cover(np.array([[numbers[0], numbers[1], 0.0]]), 1.0)
    store.grow(1, 1)
    append(store.pages, particle, store.cell_m, numbers, identity)


@pytest.mark.parametrize("x", [np.nan, np.inf, 1e7, -1e15, 1e300])
def test_a_grid_never_reaches_so_far_that_it_fills_the_memory_and_nothing_is_lost(x: float) -> None:
    store = LandmarkStore(1)
    put(store, 0, landmark(3.0, 4.0), 1)
    store.cover(np.array([[x, -x, 0.0]]), 30.0)
    put(store, 0, landmark(1e7, -1e7), 2)
    assert store.pages.grid.nbytes < 1 << 20
    assert set(map_of(store, 0)) == {1, 2}


def every_slot(store: LandmarkStore, particle: int) -> list[int]:
    used = int(store.pages.tally[USED_SLOTS])
    return [slot for slot in range(used) if store.pages.table[particle, slot] != NONE]


OPERATIONS = st.lists(
    st.one_of(
        st.tuples(st.just("add"), st.integers(0, PARTICLES - 1), st.floats(-90, 90), st.floats(-90, 90)),
        st.tuples(st.just("add"), st.integers(0, PARTICLES - 1), st.floats(0, 5), st.floats(0, 5)),
        st.tuples(st.just("move"), st.integers(0, PARTICLES - 1), st.floats(-1, 1), st.just(0.0)),
        st.tuples(st.just("doubt"), st.integers(0, PARTICLES - 1), st.floats(0, 3), st.just(0.0)),
        st.tuples(st.just("resample"), st.integers(0, PARTICLES**PARTICLES - 1), st.just(0.0), st.just(0.0)),
    ),
    max_size=60,
)


@examples(150)
@given(OPERATIONS)
def test_a_particle_never_sees_anothers_writes(operations: list[tuple[str, int, float, float]]) -> None:
    store = LandmarkStore(PARTICLES, pages=2, slots=1)
    books: list[Book] = [{} for _ in range(PARTICLES)]
    for identity, (kind, which, first, second) in enumerate(operations):
        if kind == "add":
            put(store, which, landmark(first, second, float(identity % 3)), identity)
            books[which][identity] = tuple(landmark(first, second, float(identity % 3)))
        elif kind == "move":
            for slot in every_slot(store, which):
                store.grow(0, 1)
                page = writable(store.pages, which, slot)
                store.pages.numbers[page, X, : store.pages.filled[page]] += first
            books[which] = {name: (row[0] + first, *row[1:]) for name, row in books[which].items()}
        elif kind == "doubt":
            for slot in every_slot(store, which):
                store.grow(0, 1)
                remove_below(store.pages, which, slot, first)
            books[which] = {name: row for name, row in books[which].items() if row[LOG_ODDS] >= first}
        else:
            alive = np.array([which // PARTICLES**k % PARTICLES for k in range(PARTICLES)])
            parents = np.array([k if k in alive else int(alive[0]) for k in range(PARTICLES)])
            adopt_maps(store.pages, parents)
            books = [dict(books[parent]) for parent in parents]
        assert [map_of(store, particle) for particle in range(PARTICLES)] == books
        check_books_of_pages(store)


def check_books_of_pages(store: LandmarkStore) -> None:
    """Every page is free or counted exactly as often as the table names it."""
    pages = store.pages
    named = np.bincount(pages.table[pages.table != NONE].ravel(), minlength=pages.references.size)
    assert np.array_equal(named, pages.references)
    free = pages.free[: pages.tally[FREE_PAGES]]
    assert sorted(free) == sorted(np.flatnonzero(pages.references == 0))


def test_a_full_cell_gets_more_room_and_loses_nothing() -> None:
    store = LandmarkStore(2, pages=1, slots=1)
    for identity in range(5 * PAGE_LANDMARKS):
        put(store, 0, landmark(1.0 + 0.01 * identity, 2.0), identity)
    assert sorted(map_of(store, 0)) == list(range(5 * PAGE_LANDMARKS))
    assert map_of(store, 1) == {}


def test_adopting_a_map_copies_no_page() -> None:
    store = LandmarkStore(3)
    for identity in range(40):
        put(store, 0, landmark(3.0 * identity, 0.0), identity)
    free = int(store.pages.tally[FREE_PAGES])
    adopt_maps(store.pages, np.array((0, 0, 0)))
    assert int(store.pages.tally[FREE_PAGES]) == free
    assert map_of(store, 2) == map_of(store, 0)


def test_the_map_comes_out_ordered_with_symmetric_covariances() -> None:
    store = LandmarkStore(1)
    for identity in (7, 3, 5):
        put(store, 0, landmark(10.0 * identity, 1.0), identity)
    landmarks = store.map_of(0)
    assert landmarks.identities.tolist() == [3, 5, 7]
    assert landmarks.means_m[:, 0].tolist() == [30.0, 50.0, 70.0]
    np.testing.assert_array_equal(landmarks.covariances_m2[0], ((0.1, 0.0), (0.0, 0.2)))
