"""What a person answers, rightly and wrongly."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.measurements import LinkError
from drivers.settings.can import BusSettings
from drivers.settings.layouts import DbcLayout
from runtime.errors import UsageError
from runtime.setup.discover.listen import LaserFound
from runtime.setup.discover.questions import KEYS, laser_url, measure, reversed_wheels, rover_name, yes_or_no
from runtime.setup.discover.wizard import Known, set_up
from tests.runtime.setup.discover.test_wizard import GEOMETRY, LASER, frames_of, searching


@pytest.mark.parametrize("option", KEYS)
@pytest.mark.parametrize("text", ["", "wide", "nan", "inf", "-1e9", "1e9"])
def test_a_number_that_no_rover_has_is_refused_by_the_name_of_its_option(option: str, text: str) -> None:
    with pytest.raises(UsageError, match=rf"^{option} {text}: expected "):
        measure(option, text)
    assert measure(option, "0.25") == 0.25


@pytest.mark.parametrize("text", ["", "http://x", "/dev/ttyACM0", "tcp://", "tcp://a:b"])
def test_an_address_at_which_no_laser_can_be_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match=r"^--laser .*expected tcp://HOST:PORT or serial:///dev/NAME"):
        laser_url(text)


@pytest.mark.parametrize("name", ["", "a b", "x" * 33, 'a"\nseed = 2'])
def test_a_name_that_no_key_can_hold_is_refused(name: str) -> None:
    with pytest.raises(UsageError, match="expected 1 to 32 letters, digits"):
        rover_name(name)
    assert rover_name("rover-1") == "rover-1"


@pytest.mark.parametrize(
    ("name", "known", "sentence"),
    [
        ("r1", Known("http://x", "can0"), "--laser http://x: expected tcp"),
        ("a b", Known(bus="can0"), "--rover a b: expected"),
        ("r1", Known(bus="can0", dbc=Path("nowhere.dbc")), "--dbc nowhere.dbc: cannot be read"),
    ],
)
def test_a_wrong_option_is_a_sentence_before_anything_is_searched(
    name: str, known: Known, sentence: str, tmp_path: Path
) -> None:
    def search(*_words: object) -> LaserFound:
        raise AssertionError("searched")

    with pytest.raises(UsageError, match=sentence):
        set_up(tmp_path / "a.toml", name, known, lambda: GEOMETRY, lambda _line: None, (search, search))  # type: ignore[arg-type]


@pytest.mark.parametrize(("text", "means"), [("y", True), (" Yes", True), ("N", False), ("no", False), ("", False)])
def test_yes_and_no_are_understood_and_enter_is_no(text: str, means: bool) -> None:
    assert yes_or_no(text) is means


@pytest.mark.parametrize(
    ("text", "sides"), [("", ()), ("None", ()), ("right ", ("right",)), ("both", ("left", "right"))]
)
def test_wheels_that_count_backwards_are_named(text: str, sides: tuple[str, ...]) -> None:
    assert reversed_wheels(text) == sides
    with pytest.raises(UsageError, match="front: expected left, right, both, none"):
        reversed_wheels("front")


@pytest.mark.parametrize("text", ["maybe", "yesterday", "0"])
def test_what_is_neither_yes_nor_no_is_asked_again(text: str) -> None:
    with pytest.raises(UsageError, match=f"{text}: expected y for yes or n for no"):
        yes_or_no(text)


def test_what_is_not_found_is_asked_for_until_it_is(tmp_path: Path) -> None:
    answers: Iterator[str] = iter(["tcp:/wrong", "tcp://10.0.0.7:10940", "can1"])
    asked, said = list[str](), list[str]()

    def ask(question: str) -> str:
        asked.append(question)
        return next(answers)

    def find(urls: list[str]) -> LaserFound | None:
        return LASER if urls == ["tcp://10.0.0.7:10940"] else None

    def listen(bus: BusSettings, seconds: float) -> list[object]:
        if bus.channel != "can1":
            raise LinkError("can0 is down")
        return searching(frames_of(DbcLayout()))[1](bus, seconds)  # type: ignore[return-value]

    known = Known("tcp://10.0.0.8", "can0", ask=ask)
    result = set_up(tmp_path / "a.toml", "r1", known, lambda: GEOMETRY, said.append, (find, listen))  # type: ignore[arg-type]
    assert result.bus.channel == "can1"
    assert [question.split()[0] for question in asked] == ["address", "address", "CAN"]
    assert [line for line in said if line.startswith(("asking", "listening"))] == [
        "asking    for a laser at tcp://10.0.0.8",
        "asking    for a laser at tcp://10.0.0.7:10940",
        "listening on can0 for 3 s; push the rover forward a little meanwhile",
        "listening on can1 for 3 s; push the rover forward a little meanwhile",
    ]
    assert [line for line in said if "can0 is down" in line or "no laser answered" in line or "--laser" in line] == [
        "no laser answered at tcp://10.0.0.8; check its power and cable, or give --laser URL",
        "--laser tcp:/wrong: expected tcp://HOST:PORT or serial:///dev/NAME, optionally with ?baud=N",
        "nothing was heard on can0 in 3 s: can0 is down",
    ]
