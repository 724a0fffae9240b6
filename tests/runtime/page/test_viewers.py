"""Places of viewers: who is let in, and for whom."""

import asyncio
from collections.abc import AsyncIterator

import pytest

pytest.importorskip("starlette", reason="starlette is not installed; make test installs it")
from runtime.page import viewers
from runtime.page.viewers import Client, Viewers


class Crowd:
    """Viewers whose clock is moved by hand, and who is ended."""

    def __init__(self) -> None:
        self.now_s, self.ended = 0.0, list[Client]()
        self.viewers = Viewers(endless, self.ended.append, lambda: self.now_s)

    async def comes(self, address: str, port: int) -> AsyncIterator[bytes]:
        """One that has read its first message and waits for the next."""
        stream = self.viewers.watch((address, port))
        await anext(stream)
        self.now_s += 1.0
        return stream


async def endless() -> AsyncIterator[bytes]:
    while True:
        yield b"event"


@pytest.fixture(autouse=True)
def few_places(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewers, "MOST_VIEWERS", 4)
    monkeypatch.setattr(viewers, "MOST_OF_ONE_ADDRESS", 3)
    monkeypatch.setattr(viewers, "STALLED_S", 10.0)


def test_of_one_address_the_one_that_has_watched_for_longest_gives_its_place() -> None:
    async def story() -> list[Client]:
        crowd = Crowd()
        _kept = [await crowd.comes("a", port) for port in range(5)]
        return crowd.ended

    assert asyncio.run(story()) == [("a", 0), ("a", 1)]


def test_who_has_stopped_reading_goes_before_who_has_watched_for_longest() -> None:
    async def story() -> list[Client]:
        crowd = Crowd()
        kept = [await crowd.comes("a", port) for port in range(3)]
        crowd.now_s += 20.0
        await anext(kept[0])
        await anext(kept[2])
        kept.append(await crowd.comes("a", 3))
        return crowd.ended

    assert asyncio.run(story()) == [("a", 1)]


def test_where_all_places_are_taken_the_address_that_has_most_gives_one() -> None:
    async def story() -> list[Client]:
        crowd = Crowd()
        _kept = [await crowd.comes(address, port) for port, address in enumerate("abbac")]
        _kept.append(await crowd.comes("b", 9))
        return crowd.ended

    assert asyncio.run(story()) == [("a", 0), ("b", 1)]


def test_who_goes_by_himself_leaves_his_place() -> None:
    async def story() -> list[Client]:
        crowd = Crowd()
        for port in range(20):
            stream = await crowd.comes("a", port)
            await stream.aclose()  # type: ignore[attr-defined]
        return crowd.ended

    assert asyncio.run(story()) == []
