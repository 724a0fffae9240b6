from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.scip.model import (
    NUMBER_KEYS,
    NoRange,
    ParameterError,
    is_booting,
    parse_parameters,
    range_code_meaning,
    reports_fault,
)
from drivers.simulated.laser.profiles import PROFILES

VALUES = PROFILES["UTM-30LX"].parameters.key_values()


@pytest.mark.parametrize("model", list(PROFILES))
def test_parameters_survive_the_round_trip(model: str) -> None:
    parameters = PROFILES[model].parameters
    assert parse_parameters(parameters.key_values()) == parameters


def test_further_keys_are_ignored() -> None:
    assert parse_parameters(VALUES | {"PROT": "SCIP 2.2"}) == PROFILES["UTM-30LX"].parameters


@pytest.mark.parametrize("key", ["DMIN", "DMAX", "ARES", "AMIN", "AMAX", "AFRT", "SCAN"])
def test_a_missing_or_senseless_number_is_named(key: str) -> None:
    without = {name: text for name, text in VALUES.items() if name != key}
    if key == "DMIN":  # only says which ranges are codes
        assert parse_parameters(without).range_min_mm == 20
    else:
        with pytest.raises(ParameterError, match=f"lack {key}"):
            parse_parameters(without)
    with pytest.raises(ParameterError, match=f"parameter {key} is '12x'"):
        parse_parameters(VALUES | {key: "12x"})


@pytest.mark.parametrize("form", ["000{}", "+{}", "{}.0", "{}[mm]", "{} rpm", " {} "])
def test_numbers_are_read_however_they_are_written(form: str) -> None:
    told = {key: form.format(text) if key in NUMBER_KEYS else text for key, text in VALUES.items()}
    assert parse_parameters(told) == parse_parameters(VALUES)
    assert parse_parameters({f"{key.lower()} ": text for key, text in told.items()}).step_rad > 0.0


@pytest.mark.parametrize(
    "wrong",
    [{"AFRT": "9999999"}, {"AFRT": "1441"}, {"SCAN": "0"}, {"SCAN": "1"}, {"SCAN": "9999999"}, {"ARES": "9999999"}],
)
def test_numbers_that_no_laser_has_are_refused_with_what_is_expected(wrong: dict[str, str]) -> None:
    (key,) = wrong
    with pytest.raises(ParameterError, match=rf"parameter {key} is {wrong[key]}, expected \d+ to \d+"):
        parse_parameters(VALUES | wrong)


@pytest.mark.parametrize("wrong", [{"AMAX": "0"}, {"DMIN": "60000"}, {"ARES": "500"}, {"AMAX": "20000"}])
def test_numbers_that_contradict_each_other_are_refused(wrong: dict[str, str]) -> None:
    with pytest.raises(ParameterError, match="contradict"):
        parse_parameters(VALUES | wrong)


@given(st.dictionaries(st.sampled_from(list(VALUES)), st.text(max_size=10)))
def test_arbitrary_values_raise_nothing_outside_the_family(values: dict[str, str]) -> None:
    with suppress(ParameterError):
        parse_parameters(VALUES | values)


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        *(("Sensor works well.", False), ("Stable 000 no error.", False), ("sensor is working normally", False)),
        *(("failed to synchronize", False), ("Error 100 malfunction.", True), ("Laser trouble", True)),
        *(("", False), ("a wording nobody has seen", False)),
    ],
)
def test_trouble_is_what_says_so_and_nothing_else(state: str, expected: bool) -> None:
    assert reports_fault(state) is expected


def test_booting_is_told_in_both_wordings() -> None:
    assert is_booting("001 Booting")
    assert is_booting("Booting")
    assert not is_booting("000 Idle")


@pytest.mark.parametrize(
    ("model", "code", "meaning"),
    [
        *(("UTM-30LX", 1, NoRange.TOO_FAR), ("UTM-30LX", 2, NoRange.TOO_NEAR), ("UTM-30LX", 3, NoRange.INTERFERENCE)),
        *(("UTM-30LX", 22, NoRange.OTHER), ("UTM-30LX", 60001, NoRange.TOO_FAR), ("UST-10LX", 65533, NoRange.TOO_FAR)),
        *(("URG-04LX", 0, NoRange.TOO_FAR), ("URG-04LX", 7, NoRange.INTERFERENCE)),
        ("URG-04LX", 19, NoRange.MALFUNCTION),
    ],
)
def test_a_code_means_what_its_model_means_by_it(model: str, code: int, meaning: NoRange) -> None:
    assert range_code_meaning(PROFILES[model].parameters, code) is meaning
