"""Whatever a configuration, a run or a manifest holds, it is read or refused by an error of the family, and soon.

`make test` draws a few, `make fuzz` twenty times as many; `make mutations` tries thousands on the commands themselves.
"""

import json
import random
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.errors import ConfigurationError, InfantError
from runtime.evaluate.evaluate import evaluate
from runtime.messages.tick import Record
from runtime.record.check import recover_run, run_info, verify_run
from runtime.record.folder import RunFolder
from runtime.record.manifest import Manifest
from runtime.record.mcap_file import RunWriter
from runtime.record.reader import RunReader
from runtime.replay.replay import replay_run
from runtime.report.build import build_report
from runtime.service.memory import resident_mb
from runtime.settings.configuration import load_configuration, load_configuration_text
from runtime.source_tree import CONFIG
from tests.support.examples import examples
from tests.support.mutations.__main__ import KINDS
from tests.support.mutations.commands import run_batches
from tests.support.mutations.files import mutated_bytes, mutated_text, mutated_ticks
from tests.support.runtime.hostile_runs import write_manifest
from tests.support.runtime.seeded_runs import seeded_facts

LONGEST_S = 10.0  # of the processor, which others may keep busy; what hangs ends by the limit of pytest
MOST_MB = 300.0
SEEDS = st.integers(0, 2**32)
TEXTS = [path.read_bytes() for path in sorted(CONFIG.glob("*.toml"))]
TEXTS.append(load_configuration(CONFIG / "mock.toml").text.encode())
Ticks = list[list[Record]]


@contextmanager
def soon_and_in_the_family() -> Iterator[None]:
    began_s, before_mb = time.process_time(), resident_mb()
    with suppress(InfantError):
        yield
    assert time.process_time() - began_s < LONGEST_S
    assert resident_mb() - before_mb < MOST_MB


def complaint(load: Callable[[], object]) -> str:
    """What a configuration that cannot be used is refused with, "" if it can."""
    try:
        load()
    except ConfigurationError as error:
        return str(error)
    return ""


def test_a_command_that_is_hurt_is_counted() -> None:
    """`make mutations` would prove nothing without."""

    def hurt(rng: random.Random, folder: Path) -> list[str]:
        return ["check", "--config", rng.choice(["mock", "\0"]), f"--set=seed={rng.choice(['1', 'x', '2'])}"]

    def defect() -> None:
        sys.exit(70 if "mock" in sys.argv else 3)

    with mock.patch("tests.support.mutations.commands.main", defect):
        tally = next(run_batches(hurt, range(20)))
    assert tally.tried == 20
    assert tally.codes.keys() == {3, 70}
    assert len(tally.hurt["exit 70"]) == tally.codes[70]


@pytest.mark.parametrize("kind", [name for name in KINDS if name != "runs"])
def test_a_share_of_each_kind_hurts_nothing(kind: str) -> None:
    """In a process of its own: a fork of this one would have its memory, and locks of threads that are not there."""
    words = [sys.executable, "-m", "tests.support.mutations", kind, "--share", "0.002"]
    ended = subprocess.run(words, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert int(re.search(r"(\d+) tried", ended.stdout)[1]) >= 10  # type: ignore[index]


@given(SEEDS)
@examples(50)
def test_any_configuration_is_read_or_refused_in_printable_lines(seed: int) -> None:
    rng = random.Random(seed)
    text = mutated_text(rng, rng.choice(TEXTS), TEXTS)
    began_s = time.process_time()
    with TemporaryDirectory() as folder:
        path = Path(folder) / "rover.toml"
        path.write_bytes(text)
        for said in (
            complaint(lambda: load_configuration(path)),
            complaint(lambda: load_configuration_text(text.decode(errors="replace"))),
        ):
            assert all(line.isprintable() for line in said.split("\n"))
            assert len(said) < 30_000
    assert time.process_time() - began_s < LONGEST_S


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunReader, Ticks]:
    """A whole run, and its first eight ticks as records."""
    folder = tmp_path_factory.mktemp("drive") / "run"
    seeded_facts(folder, 1, duration_s=1.5)
    replay_run(folder, None, None, True, {})  # loads the kernels
    reader, ticks = RunReader(folder), Ticks()
    for record in reader.records():
        if not ticks or (record.topic in ("/scan", "/tick") and any(each.topic == "/tick" for each in ticks[-1])):
            ticks.append([])
        ticks[-1].append(record)
    return reader, ticks[:8]


USES: dict[str, Callable[[Path, Path], object]] = {
    "info": lambda run, out: run_info(run),
    "verify": lambda run, out: verify_run(run),
    "recover": lambda run, out: (recover_run(run, RunFolder.create(out, out)), verify_run(out)),
    "evaluate": lambda run, out: evaluate(run),
    "replay": lambda run, out: replay_run(run, None, None, True, {}),
    "review": lambda run, out: build_report(run),
}


def check_messages(drive: tuple[RunReader, Ticks], seed: int, use: str) -> None:
    reader, ticks = drive
    with TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        run.mkdir()
        writer = RunWriter(run / "run.mcap", reader.header.metadata)
        for records in mutated_ticks(random.Random(seed), ticks):
            writer.add(records)
        writer.close()
        with soon_and_in_the_family():
            USES[use](run, Path(folder) / "out")


@given(seed=SEEDS, use=st.sampled_from(["verify", "recover", "evaluate"]))
@examples(20)
def test_any_message_with_right_checksums_is_read_or_refused(
    drive: tuple[RunReader, Ticks], seed: int, use: str
) -> None:
    check_messages(drive, seed, use)


@given(seed=SEEDS, use=st.sampled_from(["replay", "review"]))
@examples(4)
def test_the_filter_and_the_review_survive_any_message_too(drive: tuple[RunReader, Ticks], seed: int, use: str) -> None:
    check_messages(drive, seed, use)


@given(seed=SEEDS, use=st.sampled_from(["info", "verify", "recover", "evaluate"]))
@examples(20)
def test_any_damaged_file_of_a_run_is_read_or_refused(drive: tuple[RunReader, Ticks], seed: int, use: str) -> None:
    with TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        run.mkdir()
        content = (drive[0].folder.path / "run.mcap").read_bytes()
        (run / "run.mcap").write_bytes(mutated_bytes(random.Random(seed), content))
        with soon_and_in_the_family():
            USES[use](run, Path(folder) / "out")


SEGMENT = {"kind": "segment", "name": "run.mcap", "number": 1, "bytes": 1, "sha256": "", "ticks": 1}
LINES: list[dict[str, Any]] = [
    {"kind": "run", "created_utc": ""},
    {**SEGMENT, "first_ns": 0, "last_ns": 0},
    {"kind": "mark", "from_ns": -1, "to_ns": 1, "reason": "x"},
    {"kind": "lost", "name": "run-0007.mcap", "ticks": 3, "reason": "x"},
]
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=5,
)


@given(line=st.sampled_from(LINES), key=st.integers(0, 8), value=VALUES, seed=SEEDS, has_right_hashes=st.booleans())
@examples(20)
def test_any_manifest_is_read_or_damage(
    drive: tuple[RunReader, Ticks],
    line: dict[str, Any],
    key: int,
    value: object,
    seed: int,
    has_right_hashes: bool,
) -> None:
    with TemporaryDirectory() as folder:
        run = Path(folder)
        (run / "run.mcap").write_bytes((drive[0].folder.path / "run.mcap").read_bytes())
        changed = {**line, list(line)[key % len(line)]: value}
        path = write_manifest(run, *LINES, changed)
        if not has_right_hashes:
            path.write_bytes(mutated_bytes(random.Random(seed), path.read_bytes()))
        manifest = Manifest.load(path)
        assert manifest.damage or json.dumps(manifest.lines)
        with soon_and_in_the_family():
            verify_run(run)
            run_info(run)
