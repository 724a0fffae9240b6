"""What a review costs: the record is read once, and what is kept of a tick is its numbers."""

import tracemalloc
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np
import pytest

from runtime.record.mcap_prefix import McapPrefix
from runtime.record.reader import RunReader
from runtime.report import gather as gathering
from runtime.report.gather import Gathering, gather
from runtime.report.named_columns import NamedColumns
from slam.settings.slam import SlamSettings
from tests.support.runtime.seeded_runs import clock_drift, seeded_facts

MOST_BYTES = (
    1000  # 750 of a tick: 18 figures of its own, 40 by name, 5 of its scan, 4 of each of 5 wheel samples, 8 each
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight seconds with the laser's own bytes."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    seeded_facts(folder, 1, fault=clock_drift, duration_s=8.0)
    return folder


def test_the_record_is_read_once(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given: Counter[str] = Counter()
    messages = McapPrefix.messages

    def counted(self: McapPrefix, topics: Collection[str] | None = None) -> Iterator[tuple[str, int, bytes]]:
        for topic, log_ns, data in messages(self, topics):
            given[topic] += 1
            yield topic, log_ns, data

    held = Counter(topic for topic, _, _ in McapPrefix(run / "run.mcap").messages())
    monkeypatch.setattr(McapPrefix, "messages", counted)
    facts = gather(run)
    assert facts.device_clock.arrival_s.size == held["/raw/laser"] == 80
    for topic in ("/tick", "/estimate", "/raw/laser"):
        assert held[topic] <= given[topic] < 1.1 * held[topic], topic  # heads are read by themselves


def test_what_a_tick_leaves_in_memory_is_its_numbers(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gathering, "MOST_SCANS", 2)
    ticks = list(RunReader(run).ticks())[-20:]
    pass_ = Gathering(SlamSettings())
    held = []
    tracemalloc.start()
    for turn in range(30):
        for recorded in ticks:
            pass_.take(recorded)
        if turn in (9, 29):
            held.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert (held[1] - held[0]) / (20 * len(ticks)) < MOST_BYTES


def test_a_figure_that_comes_late_or_stays_away_is_not_a_number() -> None:
    columns = NamedColumns()
    for row in ({"a": 1.0}, {"a": 2.0, "b": 3.0}, {"b": 4.0}):
        columns.add(row)
    arrays = columns.arrays(2.0)
    np.testing.assert_array_equal(arrays["a"], [2.0, 4.0, np.nan])
    np.testing.assert_array_equal(arrays["b"], [np.nan, 6.0, 8.0])
