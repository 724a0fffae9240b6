"""Files of every kind that a command of infant reads, as somebody careless or hostile may leave them."""

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from pathlib import Path
from random import Random
from tempfile import mkdtemp
from typing import Any

from runtime.messages.tick import Record
from runtime.record.mcap_file import RunWriter
from runtime.record.reader import RunReader
from runtime.settings.configuration import load_configuration
from runtime.source_tree import CONFIG, ROOT
from tests.support.drivers.dbc import COUNTS
from tests.support.mutations.commands import BATCH, Tally, Words, run_batches
from tests.support.mutations.files import mutated_bytes, mutated_text, mutated_ticks
from tests.support.runtime.hostile_runs import write_manifest
from tests.support.runtime.measured import VEHICLE

LAYOUTS = ROOT / "drivers" / "wheels" / "layouts"
DESCRIBED = (
    """
[laser]
url = "tcp://127.0.0.1:10940"
[encoders.bus]
interface = "virtual"
channel = "x"
[encoders.layout]
kind = "{kind}"
file = "{file}"
{more}
[slam.mount]
x_m = 0.3
"""
    + VEHICLE
)
NETWORK = (  # without sensors a configuration is for recorded data, and its network is not looked at
    """
[laser]
url = "tcp://127.0.0.1:10940"
[encoders.bus]
interface = "virtual"
channel = "x"
[publish]
listen = []
connect = []
config_file = "{file}"
commands = true
[slam.mount]
x_m = 0.3
"""
    + VEHICLE
)
CLOSED = {"kind": "segment", "name": "run.mcap", "number": 1, "bytes": 1, "sha256": "", "ticks": 1}
MANIFEST: tuple[dict[str, Any], ...] = (
    {"kind": "run", "created_utc": ""},
    {**CLOSED, "first_ns": 0, "last_ns": 0},
    {"kind": "mark", "from_ns": -1, "to_ns": 1, "reason": "x"},
    {"kind": "lost", "name": "run-0007.mcap", "ticks": 3, "reason": "x"},
)
# how often each command on a run is tried, out of 100: those that draw or filter take seconds
STRIDE = 37  # through the uses, so that a few batches try many
USES = {
    "log info": 8,
    "log verify": 20,
    "log recover": 20,
    "evaluate": 18,
    "export csv": 7,
    "export ros2": 4,
    "map draw": 4,
    "calibrate": 4,
    "smooth": 3,
    "compare": 2,
    "replay": 5,
    "map save": 3,
    "review": 2,
}


def configuration(rng: Random, folder: Path) -> Words:
    """A file of ours with changes, checked or compared with the defaults."""
    path = folder / "rover.toml"
    path.write_bytes(mutated_text(rng, rng.choice(texts()), texts()))
    return ["config", "--diff", str(path)] if rng.random() < 0.2 else ["check", "--config", str(path)]


def recording(rng: Random, folder: Path) -> Words:
    """A recording of others to import, or what describes the frames of the wheels."""
    files = _recordings()
    kind = rng.choice(("dbc", "infant.dbc", "eds", "zenoh", "map", *files, "carmen", "candump", "arrays"))
    if kind in files:
        content = files[kind]
        is_text = kind in ("carmen", "candump")
        (folder / "recording").write_bytes(
            mutated_text(rng, content, list(files.values())) if is_text else mutated_bytes(rng, content)
        )
        more = ["--at-rest"] if rng.random() < 0.3 else []
        return ["import", str(folder / "recording"), "--out", str(folder / "run"), *more]
    path, config = folder / (f"{kind}.json5" if kind == "zenoh" else kind), folder / "rover.toml"
    if kind == "map":
        path.write_bytes(mutated_bytes(rng, _map()))
        return [
            *rng.choice((["map", "check"], ["map", "info"], ["map", "draw", "--out", str(folder / "o")])),
            str(path),
        ]
    path.write_bytes(mutated_text(rng, _description(kind), descriptions()))
    if kind == "zenoh":
        config.write_text(NETWORK.format(file=path))
    elif kind == "eds":
        config.write_text(DESCRIBED.format(kind="cia406", file=path, more="left_node = 1\nright_node = 2"))
    else:
        own = 'left = {message = "LW", count = "Cnt"}\nright = {message = "RW", count = "Cnt"}'
        config.write_text(DESCRIBED.format(kind="dbc", file=path, more=own if kind == "dbc" else ""))
    return ["check", "--config", str(config)]


def runs(seeds: range) -> Iterator[Tally]:
    """One command for each batch: a process that has loaded what every command needs tells nothing of any."""
    uses = [use for use, share in USES.items() for _ in range(share)]
    for first in range(seeds.start, seeds.stop, BATCH):
        use = uses[STRIDE * (first // BATCH) % len(uses)]
        yield from run_batches(partial(run, use=use), range(first, min(first + BATCH, seeds.stop)))


def run(rng: Random, folder: Path, use: str) -> Words:
    """A run whose messages, whose bytes or whose manifest were changed, for one of the commands that read runs."""
    path, out = folder / "run", folder / "out"
    path.mkdir()
    whole, ticks, metadata = drive()
    match rng.randrange(4):
        case 0 | 1:
            writer = RunWriter(path / "run.mcap", metadata)
            for records in mutated_ticks(rng, ticks):
                writer.add(records)
            writer.close()
        case 2:
            (path / "run.mcap").write_bytes(mutated_bytes(rng, whole))
            if rng.random() < 0.3:
                (path / "run-0001.mcap").write_bytes(mutated_bytes(rng, whole))
        case 3:
            (path / "run.mcap").write_bytes(whole)
            manifest = write_manifest(path, *MANIFEST)
            manifest.write_bytes(mutated_text(rng, manifest.read_bytes(), [manifest.read_bytes()]))
    if rng.random() < 0.1:
        (path / "summary.json").write_bytes(mutated_text(rng, b'{"ticks": 8, "missed": 0, "run": "x"}', texts()))
    return {
        "log recover": ["log", "recover", str(path), "--out", str(out)],
        "export csv": ["export", str(path), "--csv", str(out), "--tum", f"{out}.tum", "--geojson", f"{out}.json"],
        "export ros2": ["export", str(path), "--ros2", str(out)],
        "map draw": ["map", "draw", str(path), "--out", str(out)],
        "map save": ["map", "save", str(path), "--out", str(out)],
        "compare": ["compare", str(path), str(path), "--out", f"{out}.html"],
        "evaluate": ["evaluate", str(path), "--allow-defects"],
        "replay": ["replay", str(path), "--verify", "--allow-defects"],
        "review": ["review", str(path), "--allow-defects"],
    }.get(use, [*use.split(), str(path)])


@cache
def texts() -> list[bytes]:
    """Configurations."""
    own = [path.read_bytes() for path in sorted(CONFIG.glob("*.toml"))]
    return [*own, load_configuration(CONFIG / "mock.toml").text.encode()]


@cache
def descriptions() -> list[bytes]:
    """Of frames, and of a network."""
    return [_description(kind) for kind in ("dbc", "infant.dbc", "eds", "zenoh")]


def _description(kind: str) -> bytes:
    match kind:
        case "infant.dbc":
            return (LAYOUTS / "infant.dbc").read_bytes()
        case "eds":
            return (LAYOUTS / "encoder406.eds").read_bytes()
        case "zenoh":
            return (CONFIG / "zenoh-rover.json5").read_bytes()
        case _:
            return COUNTS.encode()


def _apart(made: Callable[[], Any]) -> Any:
    """In a process of its own: its libraries would stay in the memory of all that come after."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(made).result()


@cache
def drive() -> tuple[bytes, list[list[Record]], Any]:
    """A whole run as the bytes of its file, its first eight ticks as records, and its head."""
    found: tuple[bytes, list[list[Record]], Any] = _apart(_drive)
    return found


@cache
def _recordings() -> dict[str, bytes]:
    found: dict[str, bytes] = _apart(_files)
    return found


@cache
def _map() -> bytes:
    found: bytes = _apart(_map_bytes)
    return found


def _files() -> dict[str, bytes]:
    from tests.support.runtime.recordings import FILES

    return FILES


def _map_bytes() -> bytes:
    from tests.support.runtime.small_maps import map_bytes

    return map_bytes()


def _drive() -> tuple[bytes, list[list[Record]], Any]:
    from tests.support.runtime.seeded_runs import seeded_facts

    folder = Path(mkdtemp()) / "run"
    seeded_facts(folder, 1, duration_s=1.5)
    reader, ticks = RunReader(folder), list[list[Record]]()
    for record in reader.records():
        if not ticks or (record.topic in ("/scan", "/tick") and any(each.topic == "/tick" for each in ticks[-1])):
            ticks.append([])
        ticks[-1].append(record)
    return (folder / "run.mcap").read_bytes(), ticks[:8], reader.header.metadata
