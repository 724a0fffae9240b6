"""Values put into the text of a file change nothing else in it."""

import tomllib

import pytest

from runtime.errors import ConfigurationError
from runtime.settings.trees import put, with_value

FORMS = {
    "its own table": "[slam.mount]\nx_m = 0.1 # here\n",
    "its own table, spaced": "[ slam . mount ]\n  x_m   =   0.1\n",
    "a dotted key": "slam.mount.x_m = 0.1\n",
    "a dotted key in a table": "[slam]\nmount.x_m = 0.1\n[vehicle]\ntread_m = 0.5\n",
    "an inline table": "[slam]\nmount = { y_m = 0.0, x_m = 0.1 } # x_m = 5\n",
    "an inline table without it": "[slam]\nmount = { y_m = 0.0 }\n",
    "an empty inline table": "[slam]\nmount = {}\n",
    "a table without it": "[slam.mount]\ny_m = 0.0\n\n[slam.odometry]\ngap_s = 1.0\n",
    "a table without it, at the end": "[slam.mount]\ny_m = 0.0",
    "no table": "rover = 'a' # x_m = 3",
    "nothing": "",
    "lines of Windows": "[slam.mount]\r\nx_m = 0.1\r\n",
    "the same words in a text": 'rover = """\n[slam.mount]\nx_m = 0.1\n"""\n[slam.mount]\nx_m = 0.1\n',
    "quoted names": '["slam".\'mount\']\n"x_m" = 0.1\n',
}


@pytest.mark.parametrize("value", [0.25, True])
@pytest.mark.parametrize("text", FORMS.values(), ids=FORMS)
def test_every_way_to_write_a_key_is_changed_and_the_rest_stays(text: str, value: float | bool) -> None:
    changed = with_value(text, "slam.mount.x_m", value)
    wanted = tomllib.loads(text)
    put(wanted, "slam.mount.x_m", value)
    assert tomllib.loads(changed) == wanted
    gone = set(text.splitlines()) - set(changed.splitlines())
    assert all("mount" in line or "x_m" in line for line in gone)
    assert len(gone) <= 1
    assert changed.count("#") == text.count("#")
    assert changed.count("\r\n") == text.count("\r\n")


def test_a_form_that_cannot_be_changed_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"slam\.mount\.x_m"):
        with_value("slam = { mount = { x_m = [\n0.1] } }\n", "slam.mount.x_m", 0.2)
