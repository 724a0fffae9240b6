from typing import Annotated, Any

import pytest
from pydantic import Field, TypeAdapter, ValidationError

from runtime.expected_value import PATTERNS, expected_value
from runtime.source_tree import ROOT


@pytest.mark.parametrize(
    ("kind", "value", "words"),
    [
        (int, "x", "a whole number"),
        (int, 1.5, "a whole number"),
        (float, "x", "a number"),
        (bool, "maybe", "true or false"),
        (str, 3, "text"),
        (tuple[int, ...], 5, "a list"),
        (dict[str, int], 5, "a table"),
        (Annotated[float, Field(gt=0.05)], 0.01, "more than 0.05"),
        (Annotated[float, Field(ge=1e-06)], 0, "at least 1e-06"),
        (Annotated[int, Field(le=3)], 4, "at most 3"),
        (Annotated[str, Field(min_length=1)], "", "text of at least one character"),
        (Annotated[str, Field(pattern="^a$")], "b", "text that matches ^a$"),
        (Annotated[str, Field(pattern=r"^[a-z0-9_]+$")], "B", "lower-case letters, digits and '_'"),
    ],
)
def test_what_was_expected_is_said_in_plain_words(kind: Any, value: object, words: str) -> None:
    with pytest.raises(ValidationError) as caught:
        TypeAdapter(kind).validate_python(value)
    assert expected_value(caught.value.errors()[0]) == words


def test_every_pattern_of_a_setting_has_words() -> None:
    folders = ("drivers/settings", "slam/settings", "runtime/settings")
    texts = [file.read_text(encoding="utf-8") for folder in folders for file in (ROOT / folder).glob("*.py")]
    assert sum(text.count("pattern=r") for text in texts) == len(PATTERNS)
    assert all(any(pattern in text for text in texts) for pattern in PATTERNS)
