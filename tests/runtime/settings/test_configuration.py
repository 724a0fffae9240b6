import re
from pathlib import Path

import pytest

from runtime.errors import ConfigurationError
from runtime.settings.configuration import Configuration, load_configuration, load_configuration_text
from runtime.source_tree import ROOT
from slam.settings.front_end import GIVEN_NOISE
from slam.settings.odometry import WIDE_NOISE


@pytest.mark.parametrize("path", sorted((ROOT / "config").glob("*.toml")), ids=lambda path: path.name)
def test_every_configuration_that_we_ship_loads(path: Path) -> None:
    assert isinstance(load_configuration(path), Configuration)


def test_the_canonical_text_gives_the_same_configuration_and_hash_back() -> None:
    first = load_configuration(ROOT / "config" / "mock.toml", {"slam.particles": "37"})
    again = load_configuration_text(first.text)
    assert again == first
    assert again.sha256 == first.sha256


def test_the_hash_tells_two_configurations_apart() -> None:
    assert load_configuration_text("seed = 1").sha256 != load_configuration_text("seed = 2").sha256


@pytest.mark.parametrize(
    ("text", "pattern"),
    [
        ("[slam]\npartikles = 5", r"slam\.partikles = 5: unknown key; did you mean particles\?"),
        ("[slma]\n", r"slma = \{\}: unknown key; did you mean slam\?"),
        ("[slam]\nparticles = 'many'", r"slam\.particles = 'many': expected a whole number"),
        ("[slam]\nparticles = true", r"slam\.particles = True: expected a whole number"),
        ("[slam]\nparticles = -3", r"slam\.particles = -3: expected "),
        ("[loop]\nrate_hz = 1e9", r"loop\.rate_hz = 1000000000\.0: expected at most 100"),
        ("[publish]\nscan_hz = 1e-300", r"publish\.scan_hz = 1e-300: expected 0 or a magnitude of 1e-12 to 1e\+12"),
        ("[publish]\nscan_hz = 0.001", r"publish\.scan_hz = 0\.001: expected 0 for no scans, or at least 0\.01"),
        ("[slam.view]\nrange_max_m = 5e-324", r"slam\.view\.range_max_m = 5e-324: expected 0 or a magnitude"),
        ("seed = 1.5", r"seed = 1\.5: expected a whole number"),
        ("rover = 'a b'", r"rover = 'a b': expected 1 to 32 letters"),
        ("seed = \nrover = 1", r"not valid TOML: .*line 1"),
        ("[slam.techniques]\ndiference = false", r"slam\.techniques\.diference.*did you mean difference\?"),
    ],
)
def test_a_wrong_key_type_or_value_is_one_sentence_with_key_value_and_expectation(text: str, pattern: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        load_configuration_text(text, source="file.toml")
    assert re.search(pattern, str(caught.value)), str(caught.value)
    assert str(caught.value).startswith("file.toml: ")
    assert caught.value.exit_code == 3


@pytest.mark.parametrize("value", ["2020-01-01", "12:30:00", "2020-01-01T12:30:00Z", "[2020-01-01]"])
@pytest.mark.parametrize("key", ["rover", "publish.listen", "seed"])
def test_a_date_of_toml_is_no_text(key: str, value: str) -> None:
    with pytest.raises(ConfigurationError, match=key):
        load_configuration_text(f"{key} = {value}\n")


def test_a_file_of_an_editor_that_marks_utf_8_is_read(tmp_path: Path) -> None:
    (tmp_path / "rover.toml").write_text("seed = 7\n", encoding="utf-8-sig")
    assert load_configuration(tmp_path / "rover.toml").seed == 7


def test_all_problems_are_told_at_once() -> None:
    with pytest.raises(ConfigurationError) as caught:
        load_configuration_text("seed = -1\n[slam]\nparticles = 0\n")
    assert len(str(caught.value).splitlines()) == 2


@pytest.mark.parametrize("content", [b"\xff\xfe", None])
def test_an_unreadable_file_is_named(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "bad.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigurationError, match=r"bad\.toml"):
        load_configuration(path)


def test_an_override_reaches_its_key_and_a_wrong_one_is_named() -> None:
    assert load_configuration_text("", {"slam.particles": "7"}).slam.particles == 7
    with pytest.raises(ConfigurationError, match=r"slam\.particels = 7"):
        load_configuration_text("", {"slam.particels": "7"})
    with pytest.raises(ConfigurationError, match=r"seed is a value"):
        load_configuration_text("seed = 1", {"seed.deep": "7"})


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("loop.rate_hz", "nan"),
        ("loop.rate_hz", "1e99"),
        ("rover", "'a\\u0007'"),
        ("slam.particles", "-5"),
        ("slam.front_end.kind", "given"),
        ("slam.front_end.range_min_m", "99.0"),
    ],
)
def test_a_wrong_value_is_to_be_changed_where_it_was_given(key: str, value: str) -> None:
    *tables, last = key.split(".")
    text = f"[{'.'.join(tables)}]\n" if tables else ""
    with pytest.raises(ConfigurationError, match=r"change it in the configuration"):
        load_configuration_text(
            f"{text}{last} = {value if value != 'given' else repr(value)}\n[laser]\n", recorded=False
        )
    with pytest.raises(ConfigurationError, match=r"change it on the command line"):
        load_configuration_text("[laser]\n", {key: value}, recorded=False)


def test_noise_that_nobody_states_is_wide_for_sensors_and_bases_that_are_known_to_be_rough() -> None:
    text = '[vehicle]\nmotion_model = "speed_yaw_rate"\n[slam.front_end]\nkind = "given"\nsigma_range_m = 0.1\n'
    slam = load_configuration_text(text, recorded=False).slam
    assert (slam.front_end.sigma_range_m, slam.front_end.sigma_bearing_rad) == (0.1, GIVEN_NOISE["sigma_bearing_rad"])
    assert slam.odometry.yaw_rate_noise_radps == WIDE_NOISE["speed_yaw_rate"]["yaw_rate_noise_radps"]
    laser = load_configuration_text('rover = "x"\n', recorded=False).slam
    assert laser.front_end.sigma_range_m < 0.1 < slam.odometry.speed_noise_ratio


def test_a_file_can_say_where_a_simulated_rover_drives_and_when_what_fails() -> None:
    text = """
        [simulation.world]
        place = "orchard"
        kidnaps = [{ start_s = 9 }]
        [simulation.laser]
        faults = [{ kind = "silence", start_s = 4, duration_s = 1 }]
        [simulation.wheels]
        faults = [{ kind = "slip", start_s = 6, duration_s = 2, share = 0.5 }]
    """
    read = load_configuration_text(text, recorded=False)
    again = load_configuration_text(read.text)
    assert again.simulation == read.simulation
    assert read.simulation is not None
    assert read.simulation.world.place == "orchard"
    world, laser, wheels = read.simulation.world, read.simulation.laser, read.simulation.wheels
    assert (world.kidnaps[0].start_s, laser.faults[0].start_s, wheels.faults[0].start_s) == (9.0, 4.0, 6.0)
