"""A key can be looked up where one works, and a file compared with the defaults."""

from pathlib import Path

import pytest

from runtime.errors import UsageError
from runtime.settings.configuration import load_configuration_text
from runtime.settings.keys import distinct_keys
from runtime.setup.key_facts import all_keys, changed, changed_lines, default_lines, explained, explained_lines


def test_every_key_is_listed_with_a_default_that_a_file_may_have() -> None:
    facts = all_keys()
    sides = {"left": "wheel", "right": "wheel"}
    names = {".".join(sides.get(part, part) for part in each.key.split(".")) for each in facts}
    assert names == distinct_keys()
    lines = default_lines([each for each in facts if each.key.startswith("vehicle.")])
    load_configuration_text("\n".join(lines))


def test_the_last_word_of_a_table_is_enough_to_be_led_to_it() -> None:
    with pytest.raises(UsageError, match=r"--explain mount: no such key; did you mean slam\.mount\?"):
        explained("mount")


def test_a_key_is_explained_with_its_bounds_and_a_table_with_all_of_its_keys() -> None:
    (fact,) = explained("slam.mount.x_m")
    assert (fact.default, fact.values) == (0.0, "at least -20, at most 20")
    text = "\n".join(explained_lines([fact]))
    assert "ahead of the middle" in text
    assert {each.key for each in explained("[slam.mount]")} == {each.key for each in explained("slam.mount")}
    assert len(explained("slam.mount")) == 4
    (echo,) = explained("laser.echo")
    assert echo.values == "first, strongest, last"


@pytest.mark.parametrize(("word", "hint"), [("mount.x_m", "slam.mount.x_m"), ("nonsense.at.all", "--defaults")])
def test_a_key_that_does_not_exist_is_refused_with_what_was_meant(word: str, hint: str) -> None:
    with pytest.raises(UsageError, match=hint):
        explained(word)


def test_a_file_is_compared_with_the_defaults(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text("[laser]\nrate_hz = 5.0\ncommand = 'MD'\n[encoders]\n[encoders.right]\nsign = -1\n")
    changes = changed(path)
    assert {key: each["value"] for key, each in changes.items()} == {"laser.rate_hz": 5.0, "encoders.right.sign": -1}
    assert "laser.rate_hz = 5.0  (default 10.0)" in changed_lines(changes)
    path.write_text("")
    assert changed_lines(changed(path)) == ["nothing differs from the defaults"]
