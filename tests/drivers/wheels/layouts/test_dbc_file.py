"""Real DBC files, with whatever stands in them beside the wheels."""

import os
import resource
import time
from pathlib import Path

import pytest

from drivers.measurements import DriverError
from drivers.wheels.layouts.choose import ROVER_DBC
from drivers.wheels.layouts.cia406 import ENCODER_EDS, read_eds
from drivers.wheels.layouts.dbc_file import dbc_messages
from tests.support.drivers.dbc import COUNTS, HEAD, message, plain

OVERLAP = message(900, "DOORS", "a : 0|16@1+ (1,0) [0|0]", "b : 8|16@1+ (1,0) [0|0]")
TOO_LONG = message(901, "RADIO", "a : 60|16@1+ (1,0) [0|0]")
STRANGE = 'BA_DEF_ "Odd" NOTHING 1 2 3;\nVAL_ 4711 Ghost 0 "none" ;\nUNKNOWN_KEYWORD_ 7 ??? ;\n'
LONG = 'BA_ "SystemMessageLongSymbol" BO_ 512 "LW_that_is_called_otherwise";\n'


@pytest.mark.parametrize(
    "text",
    [
        COUNTS + OVERLAP,
        COUNTS + TOO_LONG,
        COUNTS + message(902, "TWIN_A", "a : 0|8@1+ (1,0) [0|0]") + message(902, "TWIN_B", "a : 0|8@1+ (1,0) [0|0]"),
        COUNTS + STRANGE,
        COUNTS + f'SIG_VALTYPE_ {"9" * 5000} Cnt : 1;\nBA_ "SystemMessageLongSymbol" BO_ {"9" * 5000} "x";\n',
        COUNTS.replace(
            '" B\nBO_ 513', '" B\n SG_ all : 0|48@1+ (1,0) [0|0] "" B\n SG_ 4th : 8|8@1+ (1,0) [0|0] "" B\nBO_ 513'
        ),
        COUNTS.replace("(1,0)", "(+1.,.0)"),
        COUNTS.replace("BO_ 512", "BO_ 217056256"),
        COUNTS.replace('"" B', '"Grad" '),
        COUNTS.replace("\n", "\r\n"),
        COUNTS.replace("(1,0) [0|0]", "( 1 , 0.0 )  [0|1e3x]"),
        COUNTS + 'CM_ "BO_ 512 LW: 8 A is the left one;\nBO_ 512 LW: 8 A";\n',
        COUNTS.encode("utf-8-sig"),
        COUNTS.encode("utf-16"),
        (COUNTS + 'CM_ SG_ 512 Cnt "Ángulo";\n').encode(),
        (COUNTS + 'CM_ SG_ 512 Cnt "ソ表";\n').encode("shift-jis"),  # the second bytes of both are backslashes
        (COUNTS + 'CM_ SG_ 512 Cnt "Größe in °";\n').encode("latin-1"),
        COUNTS.encode() + b'CM_ "\x81\x8d\x00";\n',
    ],
)
def test_a_file_is_judged_by_the_messages_of_the_wheels_alone(tmp_path: Path, text: str | bytes) -> None:
    pair = plain(tmp_path, text)
    assert (pair.left.counter.total, pair.right.counter.total) == (0.0, 0.0)


def test_a_message_may_be_named_by_the_long_name_that_an_attribute_gives_it(tmp_path: Path) -> None:
    path = tmp_path / "a.dbc"
    path.write_text(COUNTS + LONG)
    assert list(dbc_messages(path, ["LW_that_is_called_otherwise"])) == ["LW_that_is_called_otherwise"]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (("BO_ 386 WHEEL_R_FB", "BO_ 385 WHEEL_R_FB"), "id 0x181 is used by WHEEL_L_FB and WHEEL_R_FB"),
        (("BO_ 386 WHEEL_R_FB", "BO_ 386 WHEEL_L_FB"), "message WHEEL_L_FB is defined 2 times"),
        (("L_Speed : 32|12", "L_Speed : 30|12"), "not a usable DBC"),
        (("L_Speed : 32|12", "L_Speed : 60|12"), "not a usable DBC"),
        (("BO_ 385 ", "BO_ abc "), "message WHEEL_L_FB: there is only WHEEL_R_FB, WHEEL_L_INFO, WHEEL_R_INFO"),
        (("BO_", "XX_"), "so it is not a DBC"),
        (
            ("BO_ 385 WHEEL_L_FB: 8", "BO_ 385 WHEEL_L_FB: 99999999"),
            "WHEEL_L_FB has 99999999 bytes, a frame has at most",
        ),
        (("BO_ 385 ", f"BO_ {'9' * 5000} "), "message WHEEL_L_FB: there is only"),
        (("BO_ 385 WHEEL_L_FB: 8", f"BO_ 385 WHEEL_L_FB: {'8' * 5000}"), "message WHEEL_L_FB: there is only"),
    ],
)
def test_what_is_wrong_with_a_message_of_the_wheels_is_said(
    tmp_path: Path, change: tuple[str, str], sentence: str
) -> None:
    path = tmp_path / "bad.dbc"
    path.write_text(ROVER_DBC.read_text().replace(*change))
    with pytest.raises(DriverError, match=sentence) as caught:
        dbc_messages(path, ["WHEEL_L_FB"])
    assert "\n" not in str(caught.value)


def test_of_hundreds_of_messages_only_some_are_listed(tmp_path: Path) -> None:
    path = tmp_path / "many.dbc"
    path.write_text(HEAD + "".join(message(k + 1, f"M{k}", "a : 0|8@1+ (1,0) [0|0]") for k in range(500)))
    with pytest.raises(DriverError, match=r"there is only M0, M1, .* and 488 more"):
        dbc_messages(path, ["WHEEL_L_FB"])


@pytest.mark.parametrize("name", ["folder", "nul\0byte", "absent.dbc"])
def test_a_path_that_is_no_file_is_refused_in_one_sentence(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(DriverError, match="cannot be read"):
        dbc_messages(tmp_path / name, ["LW"])


@pytest.mark.parametrize("scale", ["(0,0)", "(1e-300,0)", "(1e300,0)", "(1,1e99)"])
def test_a_scale_that_no_count_has_is_refused(tmp_path: Path, scale: str) -> None:
    with pytest.raises(DriverError, match="has the scale"):
        plain(tmp_path, COUNTS.replace("(1,0)", scale))


def test_comments_that_never_begin_cost_time_in_proportion(tmp_path: Path) -> None:
    def used_s(lines: int) -> float:
        (tmp_path / "odd.dbc").write_text(COUNTS + "CM_ a\n" * lines)
        began_s = time.process_time()
        assert dbc_messages(tmp_path / "odd.dbc", ["LW"]).keys() == {"LW"}
        return time.process_time() - began_s

    used_s(10)
    assert used_s(80_000) < 80 * max(used_s(8000), 0.01)  # by the square it would be more


def test_a_pipe_is_no_dbc_and_keeps_nobody(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.dbc")
    with pytest.raises(DriverError, match="holds no message"):
        dbc_messages(tmp_path / "pipe.dbc", ["LW"])


@pytest.mark.parametrize("counted", ["[6004Name]\nNrOfEntries=9999999999", "[Comments]\nLines =\n 9_999_999_999"])
def test_an_eds_that_counts_to_billions_is_refused(tmp_path: Path, counted: str) -> None:
    pytest.importorskip("canopen", reason="the extra canopen is not installed")
    (tmp_path / "odd.eds").write_text(f"{ENCODER_EDS.read_text()}\n{counted}\n")
    with pytest.raises(DriverError, match="counts millions of entries"):
        read_eds(tmp_path / "odd.eds", 1)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "utf-16"])
def test_an_eds_is_read_in_whatever_encoding_it_was_saved(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "a.eds"
    path.write_bytes((ENCODER_EDS.read_text() + "\n; für Öl\n[Vendor]\nName=Müller\n").encode(encoding))
    assert 0x6004 in read_eds(path, 1)


def test_an_eds_of_more_lines_than_any_has_is_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "a.eds").write_text(ENCODER_EDS.read_text() + "[x]\n" + "".join(f"a{at}=\n" for at in range(200_000)))
    with pytest.raises(DriverError, match="has more than 100000 lines"):
        read_eds(tmp_path / "a.eds", 1)


@pytest.mark.parametrize(
    ("more", "signals", "sentence"),
    [
        ("SG_MUL_VAL_ 512 Cnt M 0-99999999;\n", "", "message LW has 100000000 values of multiplexers, of which 65536"),
        ("SG_MUL_VAL_ 512 Cnt M " + ", ".join(["0-65535"] * 500) + ";\n", "", "has 32768000 values of multiplexers"),
        (f"SG_MUL_VAL_ 512 Cnt M {'9' * 5000}-{'9' * 5000};\n", "", "values of multiplexers, of which 65536"),
        ("SG_MUL_VAL_ 512 Cnt M 1-1;\n" * 50_000, "", "message LW has 50002 lines, of which 1000"),
        ("", "".join(f' SG_ s{at} m{at} : 0|8@1+ (1,0) [0|0] "" B\n' for at in range(50_000)), "has 50002 lines"),
    ],
)
def test_a_message_that_would_fill_the_memory_is_refused_at_once(
    tmp_path: Path, more: str, signals: str, sentence: str
) -> None:
    path = tmp_path / "a.dbc"
    multiplexed = ' SG_ M M : 8|8@1+ (1,0) [0|0] "" B\n SG_ Cnt m1 : 32|32@1- (1,0) [0|0] "" B\n'
    path.write_text(HEAD + "BO_ 512 LW: 8 A\n" + signals + multiplexed + "\n" + more)
    began_s = time.process_time()
    with pytest.raises(DriverError, match=sentence):
        dbc_messages(path, ["LW"])
    assert time.process_time() - began_s < 5.0


def test_a_comment_that_does_not_end_takes_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "a.dbc"
    path.write_text(COUNTS + 'CM_ "' + 'x\\"' * 500_000)
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    dbc_messages(path, ["LW"])
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 60_000


def test_a_file_of_more_messages_than_any_has_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.dbc"
    path.write_text(COUNTS + "".join(f"BO_ {at} M{at}: 8 A\n" for at in range(21_000)))
    with pytest.raises(DriverError, match="has more than 20000 messages"):
        dbc_messages(path, ["LW"])
