import pytest

from runtime.errors import UsageError
from runtime.studies.parameter_sweep import settings_grid


def test_every_combination_of_values_comes_once() -> None:
    grid = settings_grid(["slam.particles=10,30", "slam.proposal=ekf"])
    assert grid == [{"slam.particles": "10", "slam.proposal": "ekf"}, {"slam.particles": "30", "slam.proposal": "ekf"}]
    assert settings_grid([]) == [{}]


@pytest.mark.parametrize("words", [["slam.particles"], ["=3"], ["a=1,,2"], ["a=1", "a=2"]])
def test_a_word_of_another_form_is_refused(words: list[str]) -> None:
    with pytest.raises(UsageError, match="--set"):
        settings_grid(words)
