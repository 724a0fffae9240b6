import ast
import tomllib
from pathlib import Path
from typing import Any

import pytest

from drivers.settings.encoders import EncoderSettings
from runtime.errors import ConfigurationError
from runtime.settings.configuration import load_configuration, load_configuration_text
from runtime.settings.retired import CONSTANTS, MOVED, PLACES, ignored_settings, translated
from runtime.source_tree import ROOT
from slam.settings.odometry import OdometrySettings
from slam.settings.slam import SlamSettings


def text_of(key: str, value: object) -> str:
    table, _, name = key.rpartition(".")
    return f"[{table}]\n{name} = {str(value).lower() if isinstance(value, bool) else repr(value)}\n"


def assigned(file: str, name: str) -> Any:
    """The value of a constant, or of a field with a value, as the source has it."""
    body: list[ast.stmt] = ast.parse((ROOT / file).read_text(encoding="utf-8")).body
    *classes, last = name.split(".")
    for wanted in classes:
        body = next(part.body for part in body if isinstance(part, ast.ClassDef) and part.name == wanted)
    for statement in body:
        targets = statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
        if any(isinstance(target, ast.Name) and target.id == last for target in targets):
            value = statement.value  # type: ignore[attr-defined]
            return eval(compile(ast.Expression(value), file, "eval"))
    raise AssertionError(f"{file} has no {name}")


@pytest.mark.parametrize("file", CONSTANTS)
def test_each_constant_stands_where_the_sentence_says_with_the_value_of_the_old_default(file: str) -> None:
    in_other_units = {"slam.association.match_floor": -2.0, "slam.association.match_fixed": -2.0}
    for key, (value, name) in CONSTANTS[file].items():
        factor = in_other_units.get(key)
        assert assigned(file, name) == (value if factor is None else factor * value), key


def test_a_file_with_a_key_of_the_past_is_told_where_its_number_is(tmp_path: Path) -> None:
    for key, (value, place) in PLACES.items():
        path = tmp_path / "rover.toml"
        path.write_text(text_of(key, value))
        with pytest.raises(ConfigurationError) as caught:
            load_configuration(path)
        assert str(caught.value) == (
            f"{path}: {key}: is no longer a setting (it is {value}, see {place}); remove the line"
        )
        assert caught.value.exit_code == 3


@pytest.mark.parametrize("key", MOVED)
def test_a_file_with_a_key_that_moved_is_told_the_new_one(key: str, tmp_path: Path) -> None:
    path = tmp_path / "rover.toml"
    path.write_text(text_of(key, 1))
    with pytest.raises(ConfigurationError) as caught:
        load_configuration(path)
    assert str(caught.value) == (f"{path}: {key}: is no longer a setting; give {' and '.join(MOVED[key].keys)} instead")
    with pytest.raises(ConfigurationError, match="is no longer a setting; give"):
        load_configuration_text("", {key: "1"})


NAMED_FAULT = '[simulation.wheels]\nfaults = [{ name = "slip", share = 0.5 }]\n'


def test_the_kind_of_a_fault_of_the_wheels_is_no_longer_called_its_name(tmp_path: Path) -> None:
    (tmp_path / "rover.toml").write_text(NAMED_FAULT)
    with pytest.raises(
        ConfigurationError, match=r"wheels\.faults\.name: is no longer a setting; give .*\.faults\.kind"
    ):
        load_configuration(tmp_path / "rover.toml")
    recorded = load_configuration_text(NAMED_FAULT)
    assert recorded.simulation is not None
    assert [(fault.kind, fault.share) for fault in recorded.simulation.wheels.faults] == [("slip", 0.5)]


@pytest.mark.parametrize("key", ["slam.odometry.jump_speed_mps", "encoders.vehicle"])
def test_what_is_handed_on_from_the_vehicle_is_no_key(key: str) -> None:
    for recorded in (True, False):
        with pytest.raises(ConfigurationError, match=rf"{key}: unknown key; the geometry is set in \[vehicle\]"):
            load_configuration_text(text_of(key, 1), recorded=recorded)


def test_filter_and_driver_have_the_geometry_of_the_vehicle() -> None:
    text = (
        '[vehicle]\nmotion_model = "steered"\nwheel_radius_left_m = 0.2\nwheel_radius_right_m = 0.4\ntread_m = 0.7\n'
        "counts_per_rev = 2048\nwheel_base_m = 1.1\nmax_speed_mps = 2.0\n[encoders]\n"
    )
    configuration = load_configuration_text(text, recorded=False)
    odometry, encoders = configuration.slam.odometry, configuration.encoders
    assert odometry.model == "steered"
    assert (odometry.wheel_radius_left_m, odometry.wheel_radius_right_m, odometry.tread_m) == (0.2, 0.4, 0.7)
    assert (odometry.counts_per_rev, odometry.wheel_base_m, odometry.jump_speed_mps) == (2048.0, 1.1, 3.0)
    assert encoders is not None
    assert encoders.counts_per_metre == pytest.approx(2048 / (2 * 3.14159265 * 0.3))
    assert encoders.vehicle == configuration.vehicle
    assert load_configuration_text(configuration.text, recorded=False) == configuration


def test_the_defaults_of_the_vehicle_are_those_that_filter_and_driver_have_without_it() -> None:
    handed = load_configuration_text("[encoders]\n", recorded=False)
    assert handed.slam.odometry == OdometrySettings(jump_speed_mps=handed.vehicle.jump_speed_mps)
    assert handed.encoders == EncoderSettings()


OLD = """
[slam.odometry]
model = "differential"
wheel_radius_left_m = 0.077
wheel_radius_right_m = 0.078
counts_per_rev = 2000.0
max_speed_mps = 40.0
gap_s = 0.4
[slam.association]
strategy = "sequential"
match_base = -3.0
match_per_metre = 0.6
match_known = -25.0
[slam.joint]
match_base_square = 6.0
match_per_metre_square = 1.2
match_known_square = 50.0
[slam.existence]
seen = 1.0
[encoders]
counts_per_rev = 4096.0
wheel_radius_m = 0.125
max_speed_mps = 1.944
"""


def test_a_recorded_configuration_of_before_is_the_same_filter() -> None:
    odometry = OdometrySettings(
        wheel_radius_left_m=0.077, wheel_radius_right_m=0.078, counts_per_rev=2000.0, jump_speed_mps=40.0, gap_s=0.4
    )
    assert load_configuration_text(OLD).slam == SlamSettings(odometry=odometry)
    assert ignored_settings(OLD) == []


def test_the_whole_configuration_of_a_run_of_before_is_read_and_nothing_of_it_is_ignored() -> None:
    text = (Path(__file__).with_name("recorded_before.toml")).read_text(encoding="utf-8")
    assert ignored_settings(text) == []
    before = load_configuration_text(text)
    today = load_configuration(ROOT / "config" / "mock.toml")
    assert before.slam.odometry.jump_speed_mps == 40.0
    vehicle = before.vehicle.model_copy(update={"max_speed_mps": today.vehicle.max_speed_mps})
    floors = {name: getattr(today.slam.front_end, name) for name in ("sigma_range_floor_m", "sigma_bearing_floor_rad")}
    front_end = before.slam.front_end.model_copy(update=floors)  # decision 43
    # the score was another measure then
    slam = before.slam.model_copy(update={"quality": today.slam.quality, "front_end": front_end})
    assert load_configuration_text(before.model_copy(update={"vehicle": vehicle, "slam": slam}).text) == today


def test_gates_arrive_at_the_kernels_as_the_numbers_that_they_were() -> None:
    tuning = load_configuration_text(OLD).slam.tuning()
    assert (tuning.match_square, tuning.match_per_metre_square) == (-2.0 * -3.0, 2.0 * 0.6)
    assert (tuning.match_widest_square, tuning.match_fixed_square) == (-2.0 * -8.0, -2.0 * -4.605)
    assert (tuning.match_known_square, tuning.create_square) == (-2.0 * -25.0, 50.0)


def test_what_a_record_says_and_is_done_no_more_is_named() -> None:
    changed = OLD.replace("seen = 1.0", "seen = 1.5").replace("match_base_square = 6.0", "match_base_square = 9.0")
    assert ignored_settings(changed) == [
        "slam.joint.match_base_square = 9.0 is ignored, slam.gates.match is 6.0",
        "slam.existence.seen = 1.5 is ignored, it is 1.0 (Tuning.log_odds_seen in slam/settings/tuning.py)",
    ]
    tree = tomllib.loads(changed)
    assert "existence" not in translated(tree)[0]["slam"]
    assert tree == tomllib.loads(changed), "the tree itself is left alone"
