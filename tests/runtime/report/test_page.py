import pytest
from jinja2 import UndefinedError

from runtime.report.page import keys_marked, rendered

COMPARED = {
    "verdicts": ["healthy", "healthy"],
    "rows": [],
    "script": "",
    "drawings": {},
    "findings": [],
    "configuration": [],
}


def test_keys_of_the_configuration_stand_out_from_the_words_of_a_remedy() -> None:
    marked = keys_marked("slam.mount.yaw_rad = 0.0314; else check the [encoders.bus] and <loop.rate_hz> twice.")
    assert "<code>slam.mount.yaw_rad = 0.0314</code>; else check the <code>[encoders.bus]</code>" in marked
    assert "&lt;<code>loop.rate_hz</code>&gt; twice." in marked


def test_a_remedy_without_keys_is_plain_words() -> None:
    sentence = "check the laser's power supply and plug. Then drive on"
    assert "<code>" not in keys_marked(sentence)


def test_what_a_run_is_called_cannot_become_part_of_the_page() -> None:
    written = rendered("compare.html", **COMPARED, names=["<script>", "b"])
    assert "<script> and" not in written
    assert "&lt;script&gt; and" in written


def test_a_page_that_lacks_a_value_is_not_written() -> None:
    with pytest.raises(UndefinedError, match="verdicts"):
        rendered("compare.html", names=["a", "b"])
