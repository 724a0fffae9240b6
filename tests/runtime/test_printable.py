import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.printable import coloured, printable, printable_lines
from tests.support.examples import examples


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("laser UTM-30LX, 30 m, ±5 mm", "laser UTM-30LX, 30 m, ±5 mm"),
        ("\x1b[2J\x07", "\\x1b[2J\\x07"),
        ("a\r\nFAKE", "a\\r\\nFAKE"),
        ("\x9b31m", "\\x9b31m"),
        ("\u202egnp.exe", "\\u202egnp.exe"),
        ("b\udce4d", "b\\udce4d"),
        ("\u2028", "\\u2028"),
    ],
)
def test_what_moves_a_cursor_stands_as_an_escape(text: str, shown: str) -> None:
    assert printable(text) == shown


@given(st.text(st.characters()))
@examples(100)
def test_the_result_is_one_printable_line_and_stays_as_it_is(text: str) -> None:
    shown = printable(text)
    assert shown.isprintable()
    assert printable(shown) == shown
    shown.encode()


def test_a_long_text_is_cut_and_says_so() -> None:
    assert printable("x" * 5000, 10) == "xxxxxxxxxx ... (5000 characters)"


def test_a_sentence_of_ours_keeps_its_lines() -> None:
    assert printable_lines("one\ntwo\x1b") == "one\ntwo\\x1b"


@pytest.mark.parametrize(
    ("line", "shown"),
    [
        ("WARN clock  not synchronised: failed", "\x1b[33mWARN\x1b[0m clock  not synchronised: failed"),
        ("r1  host  degraded  12  laser:stale", "r1  host  \x1b[33mdegraded\x1b[0m  12  laser:stale"),
        ("tick 12  lost (pose lost)", "tick 12  \x1b[31mlost\x1b[0m (pose lost)"),
        ("tick 12  landmarks 3", "tick 12  landmarks 3"),
    ],
)
def test_the_first_state_of_a_line_has_its_colour(line: str, shown: str) -> None:
    assert coloured(line) == shown
