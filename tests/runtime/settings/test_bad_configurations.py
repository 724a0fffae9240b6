"""Each of many hundred wrong configurations is refused in one sentence with key, value and expectation; none starts."""

import random
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest

from runtime.errors import ConfigurationError
from runtime.settings.configuration import load_configuration, load_configuration_text
from runtime.source_tree import ROOT
from tests.support.runtime.bad_configurations import Bad, broken, generated

SEED = 20
LEAST = 200
EXPECTATION = re.compile(
    r"expected |unknown key; (did you mean \w+\?|known keys here: )|missing; |not valid TOML: .*line \d+"
)
WHOLE = load_configuration(ROOT / "config" / "rover.toml").text
GENERATED = [*generated(random.Random(SEED)), *broken(WHOLE, random.Random(SEED))]
ROVER = '[laser]\nurl = "tcp://127.0.0.1:9"\n[encoders.bus]\ninterface = "virtual"\n'


def refusal(text: str) -> str:
    with pytest.raises(ConfigurationError) as caught:
        load_configuration_text(text, source="rover.toml")
    assert caught.value.exit_code == 3
    return str(caught.value)


def complaint(bad: Bad) -> str:
    """What is wrong with the refusal of a bad configuration, empty if nothing is."""
    try:
        load_configuration_text(bad.text, source="rover.toml")
    except ConfigurationError as error:
        sentence = str(error)
    else:
        return "accepted"
    stands = f"rover.toml: {bad.key} = {bad.value}: " if bad.value else f"rover.toml: {bad.key}: "
    if sentence.startswith(stands) and EXPECTATION.search(sentence) and len(sentence.splitlines()) == 1:
        return ""
    return sentence


@pytest.mark.parametrize("kind", ["type", "range", "spelling", "toml"])
def test_each_is_refused_with_its_key_its_value_and_what_was_expected(kind: str) -> None:
    chosen = [bad for bad in GENERATED if bad.kind == kind]
    assert len(chosen) >= LEAST // 4
    wrong = {str(bad): said for bad in chosen if (said := complaint(bad))}
    assert not wrong


def test_there_are_far_more_than_asked_for_and_every_table_is_among_them() -> None:
    assert len({bad.text for bad in GENERATED}) > 3 * LEAST
    tables = {bad.key.split(".")[0] for bad in GENERATED}
    assert tables >= {"slam", "laser", "encoders", "loop", "record", "publish", "review", "simulation"}


def test_a_misspelt_key_is_answered_with_the_right_one() -> None:
    chosen = [bad for bad in GENERATED if bad.kind == "spelling"]
    right = sum(f"did you mean {bad.hint}?" in refusal(bad.text) for bad in chosen)
    assert right >= 0.95 * len(chosen)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[laser]\nangle_min_deg = 40\nangle_max_deg = 30", "angle_min_deg below angle_max_deg, not 40.0 and 30.0"),
        ("[laser]\nurl = 'http://laser'", "laser.url = 'http://laser': expected"),
        ("[encoders.layout]\nfile = 'x.dbc'", "encoders.layout.kind: missing; it says what this table describes"),
        ("[encoders.layout]\nkind = 'dbf'", "encoders.layout.kind = 'dbf': expected one of 'dbc', 'preset'"),
        ("[vehicle]\nmotion_model = 'tracked'", "vehicle.motion_model = 'tracked': expected 'differential', 'steered'"),
        ("[vehicle]\nwheel_radius_left_m = 125", "vehicle.wheel_radius_left_m = 125: expected at most 2"),
        ("[vehicle]\nwheel_radius_m = 0.1", "vehicle.wheel_radius_m = 0.1: unknown key; did you mean wheel_"),
        ("[slam.gates]\nmatch = -3.0", "slam.gates.match = -3.0: expected at least 0"),
        ("[encoders.layout]\nkind = 'dbc'\nfile = ''", "encoders.layout.dbc.file = '': expected"),
        ("[simulation.world]\npeople = -1", "simulation.world.people = -1: expected at least 0"),
        ("[publish]\ncommands = true", "config_file to name a zenoh configuration"),
        ("[publish]\nlisten = ['127.0.0.1']", "publish.listen.0 = '127.0.0.1': expected"),
    ],
)
def test_keys_that_do_not_go_together_are_refused(text: str, sentence: str) -> None:
    said = refusal(text)
    assert said.startswith("rover.toml: ")
    assert sentence in said


AT_THE_COMMAND_LINE = [
    ("no such file", None, "rover.toml: cannot be read (No such file or directory); give the path of a TOML file"),
    ("no text", b"\xff\xfe\x00", "rover.toml: byte 0 is not UTF-8"),
    ("no TOML", b"[laser\n", "rover.toml: not valid TOML"),
    ("no laser", ROVER.replace("[laser]\nurl", "rover"), "expected"),
    ("a wrong type", b"seed = 'one'\n", "seed = 'one': expected a whole number"),
    ("no sensors", b"seed = 1\n", "laser: missing; a live run needs the tables [laser] and [encoders]"),
    ("no geometry", ROVER, "vehicle.wheel_radius_left_m: missing; measure it on the rover"),
    ("no such bus", ROVER.replace("virtual", "socketcam"), "encoders.bus.interface = 'socketcam': expected one of"),
    (
        "no such DBC",
        ROVER + '[encoders.layout]\nkind = "dbc"\nfile = "none.dbc"\n',
        "none.dbc: cannot be read (No such file or directory); give the path of a DBC",
    ),
    (
        "no such message",
        ROVER + '[encoders.layout]\nkind = "dbc"\n[encoders.layout.left]\nmessage = "WHEEL_X"\ncount = "L_Count"\n',
        "encoders.layout: ",
    ),
    (
        "no zenoh file",
        ROVER + '[publish]\nconfig_file = "none.json5"\n',
        "publish.config_file = 'none.json5': no such file; give a zenoh configuration in JSON5",
    ),
]


@dataclass(frozen=True, slots=True)
class Ended:
    """How one start ended, and what it left beside its configuration."""

    code: int
    said: str
    config: Path
    made: list[Path]


def started(folder: Path, content: str | bytes | None) -> Ended:
    folder.mkdir()
    config = folder / "rover.toml"
    if content is not None:
        config.write_bytes(content.encode() if isinstance(content, str) else content)
    command = [sys.executable, "-m", "runtime.cli", "run", "--config", str(config), "--out", str(folder / "run")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=1000, check=False)
    return Ended(done.returncode, done.stderr, config, [path for path in folder.rglob("*") if path != config])


@pytest.fixture(scope="module")
def ends(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Ended]:
    """All of them at once: most of a start is reading programs."""
    folder = tmp_path_factory.mktemp("starts")
    with ThreadPoolExecutor(4) as pool:
        made = {name: pool.submit(started, folder / name, content) for name, content, _ in AT_THE_COMMAND_LINE}
        return {name: future.result() for name, future in made.items()}


@pytest.mark.parametrize(("name", "sentence"), [(name, sentence) for name, _, sentence in AT_THE_COMMAND_LINE])
def test_the_command_line_ends_with_3_and_starts_nothing(name: str, sentence: str, ends: dict[str, Ended]) -> None:
    ended = ends[name]
    assert ended.code == 3, ended.said
    assert ended.said.startswith("infant: ")
    assert sentence in ended.said
    assert str(ended.config) in ended.said
    assert "Traceback" not in ended.said
    assert not ended.made
