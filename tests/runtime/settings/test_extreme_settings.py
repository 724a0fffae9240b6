"""Whatever number of [slam] and [vehicle] is accepted, the estimator runs with it; what means nothing is refused."""

from collections.abc import Iterator

import pytest

from runtime.errors import ConfigurationError
from runtime.record.reader import RunReader
from runtime.replay.replay import replay
from runtime.settings.configuration import load_configuration_text
from runtime.settings.keys import tables
from tests.support.runtime.seeded_runs import seeded_facts

NEXT_TO_NOTHING = 1e-9
Limits = tuple[float, float]


def numbers() -> Iterator[tuple[str, Limits]]:
    """Keys of the estimator that are no whole numbers, and what their fields say of least and most."""
    for table in tables():
        if table.path.split(".")[0] not in ("slam", "vehicle"):
            continue
        for name, field in table.leaves():
            if field.annotation is not float:
                continue
            ends = ("ge", "gt", "le", "lt")
            bounds = [float(getattr(each, end)) for each in field.metadata for end in ends if hasattr(each, end)]
            yield f"{table.path}.{name}", (min(bounds), max(bounds))


NUMBERS = dict(numbers())


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> RunReader:
    folder = tmp_path_factory.mktemp("drive") / "run"
    seeded_facts(folder, 1, duration_s=1.5)
    return RunReader(folder)


@pytest.mark.parametrize("key", NUMBERS)
def test_the_ends_of_every_range_run(drive: RunReader, key: str) -> None:
    least, most = NUMBERS[key]
    ran = 0
    for value in (least, least + NEXT_TO_NOTHING, most):
        try:
            configuration = load_configuration_text(drive.header.configuration_text, {key: repr(value)})
        except ConfigurationError:
            continue  # the end itself is outside, or another key forbids it
        result = replay(drive, configuration)
        assert result.defect == ""
        ran += 1
    assert ran >= 1


@pytest.mark.parametrize("key", NUMBERS)
@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e300", "-1e300", "1e-300", "1e12"])
def test_numbers_that_nobody_means_are_refused_in_one_sentence(key: str, value: str) -> None:
    with pytest.raises(ConfigurationError, match=r"^[^\n]*expected [^\n]*$") as caught:
        load_configuration_text("", {key: value})
    assert f"{key} = " in str(caught.value)


@pytest.mark.parametrize(
    "key",
    [
        "slam.view.range_max_m",
        "slam.front_end.range_max_m",
        "slam.front_end.width_max_m",
        "slam.front_end.sigma_range_m",
        "slam.front_end.sigma_bearing_rad",
        "slam.odometry.noise_time_s",
        "slam.odometry.gap_s",
        "slam.quality.lost_score",
        "slam.quality.uncertain_blind_s",
        "slam.quality.lost_blind_s",
    ],
)
def test_a_length_time_or_deviation_next_to_nothing_is_refused_where_it_leaves_nothing_to_work_with(key: str) -> None:
    """A laser that sees 1 nm has no landmarks, and nobody would know why."""
    with pytest.raises(ConfigurationError, match=rf"{key} = 1e-06: expected at least "):
        load_configuration_text("", {key: "1e-6"})


def test_returns_are_kept_between_the_nearest_and_the_farthest() -> None:
    with pytest.raises(ConfigurationError, match=r"expected range_min_m below range_max_m, not 10\.0 and 4\.0"):
        load_configuration_text("[slam.front_end]\nrange_min_m = 10.0\nrange_max_m = 4.0\n")


@pytest.mark.parametrize(("key", "value"), [("slam.front_end.kind", "given"), ("slam.association.strategy", "known")])
def test_a_laser_that_is_to_name_its_landmarks_is_refused(key: str, value: str) -> None:
    """Every step ended as a prediction: a TypeError ten times a second."""
    laser = '[laser]\nurl = "tcp://127.0.0.1:9"\n'
    *tables_, last = key.split(".")
    text = f'{laser}[{".".join(tables_)}]\n{last} = "{value}"\n'
    with pytest.raises(ConfigurationError, match=rf"{key} = '{value}': expected .* with the table \[laser\]"):
        load_configuration_text(text, recorded=False)
    with pytest.raises(ConfigurationError, match=key):
        load_configuration_text(laser, {key: value})
    load_configuration_text(text)  # an old run stays readable
