"""What people read is plain, idiomatic English, as far as a tool can tell."""

import re

import pytest

from tests.support.prose import SENTENCE, help_texts, page_text, pages, sentences_of_the_source

pytest.importorskip("proselint", reason="proselint is not installed; make test installs it")

from proselint.checks import __register__
from proselint.config import DEFAULT
from proselint.registry import CheckRegistry
from proselint.tools import LintFile

CheckRegistry().register_many(__register__)
OFF = ("typography", "restricted", "dates_times")  # curly quotes; a vocabulary of a thousand words; "2 am"
CHECKS = {**DEFAULT, "checks": {name: on and name not in OFF for name, on in DEFAULT["checks"].items()}}
LONGEST_SENTENCE = 30  # words
OURS = {
    r"\banew\b": "again",
    r"\bbegan again\b": "restarted",
    r"\bbeside\b": "next to, or in addition to",
    r"\bof its own\b": "its own X, or a separate X",
    r"\btells? from\b": "distinguishes from",
    r"\btells of\b": "reports",
    r"\bhungry\b": "busy",
    r"\bshall\b": "must, or is to",
    r"\bmend(?:s|ed)?\b": "fix, or correct",
    r"\b(?:key|table|number|value|list|sentence|reason|rule)s? stands?\b": "is",
    r"\bstands? (?:beside|below|above|between|once|there)\b": "is",
    r"(?<!there )\bis no (?:file|folder|map|run|rover|number|link|address|text|value|frame|DBC|EDS|time)\b": "is not a",
    r"\bcannot be believed\b": "cannot be trusted, or is damaged",
    r"\bpassed over\b": "ignored",
    r"\bis not whole\b": "is incomplete",
    r"\bthan life\b": "than real time",
    r"\bof use\b": "usable",
    r"\bgives? no answer\b": "does not answer",
    r"\bwhere that is\b": "if that is",
    r"\bnothing is said\b": "it is not given",
    r"\blooked for\b": "searched for",
    r"\bdo without\b": "need",
    r"\boverwritten, give\b": "overwritten; give",
    r"\b(?:measure|measure it)[^.;:]*, geometry\b": "geometry, after a colon or with because",
    r"\bis none of the\b": "is not a",
    r"\bhalf an? (?:pose|map|file)\b": "an incomplete",
    r"\bthat no (?:clock|drive|device|recorder) \w+": "invalid, or out of range",
    r"\bwhole (?:lines?|ticks?)\b": "complete",
    r"\b(?:is|are) nowhere\b": "is not finite",
    r"\bstamp lies\b": "stamp is",
    r"\blies (?:under|below|after|before)\b": "is",
    r"\bstands (?:upright|in \[)": "is",
    r"\bneeds? the extra\b": "needs optional packages",
    r"\bnot a single\b": "no",
    r"\bto be relied on\b": "reliable",
    r"\bplace landmarks\b": "put up landmarks, such as posts",
    r", wanted\b": "and N are needed",
    r"\brefutes?\b": "contradicts",
    r"\ball the same\b": "anyway",
}
"""Phrases that a native speaker would not write here, and what to write."""


@pytest.fixture(scope="module")
def texts() -> list[tuple[str, str]]:
    """Place and text of all that is read."""
    return [
        *((path.name, page_text(path)) for path in pages()),
        *help_texts(),
        *sentences_of_the_source(),
    ]


def test_proselint_finds_nothing(texts: list[tuple[str, str]]) -> None:
    found = []
    for place, text in texts:
        for result in LintFile(place, text or " ").lint(CHECKS):
            start, end = result.check_result.span
            found.append(f"{place}: {text[max(0, start - 31) : end + 30]!r}: {result.check_result.message}")
    assert found == []


def test_no_phrase_is_used_that_a_native_speaker_would_not_write(texts: list[tuple[str, str]]) -> None:
    found = [
        f"{place}: {text[max(0, match.start() - 30) : match.end() + 30]!r}: write {better}"
        for place, text in texts
        for phrase, better in OURS.items()
        for match in re.finditer(phrase, text, re.IGNORECASE)
    ]
    assert found == []


def test_no_sentence_of_a_page_is_too_long_to_be_read_aloud() -> None:
    found = [
        f"{path.name}: {len(sentence.split())} words: {sentence}"
        for path in pages()
        for line in page_text(path).splitlines()
        for sentence in SENTENCE.split(line)
        if len(sentence.split()) > LONGEST_SENTENCE
    ]
    assert found == []


def test_the_checks_see_what_they_are_for() -> None:
    bad = "The key stands in the table beside it, which is very unique; it is no map."
    assert LintFile("bad", bad).lint(CHECKS)
    assert sum(bool(re.search(phrase, bad)) for phrase in OURS) >= 3
    assert len(list(sentences_of_the_source())) > 1000
    assert all(len(page_text(path).split()) > 50 for path in pages())
