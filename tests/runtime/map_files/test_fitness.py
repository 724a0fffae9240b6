"""A map of another sensor is refused, one of another mount is taken with a sentence; what is suspicious is named."""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runtime.errors import ConfigurationError, NotAMapError, UsageError
from runtime.map_files.fitness import distance_outside, findings, suits
from runtime.map_files.map_file import SavedMap, encode_map
from runtime.map_files.start import choose_start
from runtime.maps.info import check_lines, check_map, info_lines, map_info
from runtime.maps.merge import merge_files
from runtime.settings.configuration import load_configuration_text
from slam.pose import Pose2
from tests.support.runtime.small_maps import FACTS, map_bytes, small_map

SAVED = SavedMap(small_map(), FACTS)


def notes_for(text: str) -> tuple[str, ...]:
    fitness = suits(SAVED, "hall.map", load_configuration_text(text))
    assert fitness.refusal == ""
    return fitness.notes


def test_the_rover_that_made_a_map_may_use_it() -> None:
    assert notes_for("[slam.mount]\nx_m = 0.3\n") == ()


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[slam.mount]\nx_m = -0.2\n", "0.50 m and 0.0 deg"),
        ("[slam.mount]\nx_m = 0.3\nyaw_rad = 3.14159\n", "180.0 deg"),
        ("[slam.mount]\nx_m = 0.3\nupside_down = true\n", "upright, which it is not here"),
        ("[slam.mount]\nx_m = 0.3\n[slam.view]\nrange_max_m = 4.0\n", "range_max_m"),
    ],
)
def test_what_differs_is_said(text: str, why: str) -> None:
    (note,) = notes_for(text)
    assert why in note


def test_a_map_of_another_kind_of_sensor_is_refused(tmp_path: Path) -> None:
    given = "[slam.front_end]\nkind = 'given'\n"
    assert "slam.front_end.kind = robust, here given" in suits(SAVED, "x", load_configuration_text(given)).refusal
    (tmp_path / "hall.map").write_bytes(map_bytes())
    (tmp_path / "other.toml").write_text(given)
    with pytest.raises(ConfigurationError, match="another kind of sensor"):
        check_map(tmp_path / "hall.map", tmp_path / "other.toml")


def test_a_map_that_only_another_release_understands_is_refused_with_that_remedy(tmp_path: Path) -> None:
    told = replace(FACTS, configuration_text="[slam.mount]\ntilt_rad = 0.1\n")
    hall, yard = tmp_path / "hall.map", tmp_path / "yard.map"
    hall.write_bytes(map_bytes(facts=told))
    yard.write_bytes(map_bytes())
    why = r"hall\.map: slam\.mount\.tilt_rad = 0\.1: unknown key; another release wrote this map: use that one"
    with pytest.raises(NotAMapError, match=why):
        choose_start(hall, True, None, load_configuration_text(""))
    for first, second in ((hall, yard), (yard, hall)):
        with pytest.raises(NotAMapError, match=why):
            merge_files(first, second, tmp_path / "both.map")


def test_a_map_too_small_to_be_searched_is_found() -> None:
    few = small_map(5)
    assert findings(SavedMap(few, FACTS)) == []
    few = replace(few, view_poses=few.view_poses[:0], view_points_cm=few.view_points_cm[:0])
    (finding,) = findings(SavedMap(few, FACTS))
    assert finding.startswith("5 landmarks and no view of walls")


def test_twins_and_vague_landmarks_are_found() -> None:
    assert findings(SAVED) == []
    joint = small_map()
    means = joint.means_m.copy()
    means[3] = means[7] + 0.05
    vague = joint.covariances_m2.copy()
    vague[20:25] *= 1e4
    found = findings(SavedMap(replace(joint, means_m=means, covariances_m2=vague), FACTS))
    assert [sentence.partition(": ")[2][0] for sentence in found] == ["5", "1"]


def test_how_far_a_pose_lies_outside() -> None:
    x, y = SAVED.joint.means_m[0]
    assert distance_outside(SAVED, Pose2(x + 0.3, y + 0.4)) <= 0.5
    assert distance_outside(SAVED, Pose2(500.0, 0.0)) > 440.0


def test_what_a_map_holds_is_shown(tmp_path: Path) -> None:
    path = tmp_path / "hall.map"
    path.write_bytes(encode_map(small_map(), replace(FACTS, predecessor="ab" * 32)))
    facts = map_info(path)
    assert facts["landmarks"] == 40
    assert facts["runs"] == ["monday"]
    assert np.all(np.array(facts["low_m"]) < facts["high_m"])
    assert any("40" in line for line in info_lines(facts))
    assert check_lines(check_map(path, None)) == [f"intact    {path}: 40 landmarks, sha256 {facts['sha256']}"]


def test_ten_thousand_landmarks_at_one_place_are_counted_and_not_listed() -> None:
    heap = replace(small_map(10_000), means_m=np.zeros((10_000, 2)))
    tracemalloc.start()
    found = findings(SavedMap(heap, FACTS))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert any("49995000 pairs" in sentence for sentence in found)
    assert peak < 20e6


def test_a_map_whose_landmarks_leave_the_start_open_is_refused(tmp_path: Path) -> None:
    whole = small_map()
    (tmp_path / "hall.map").write_bytes(encode_map(replace(whole, weights=1e3 * np.ones_like(whole.weights)), FACTS))
    rover = load_configuration_text("[slam.mount]\nx_m = 0.3\n")
    with pytest.raises(NotAMapError, match="does not say how accurately its landmarks"):
        choose_start(tmp_path / "hall.map", False, "0,0,0", rover)
    (tmp_path / "good.map").write_bytes(map_bytes())
    assert choose_start(tmp_path / "good.map", False, "0,0,0", rover) is not None
    with pytest.raises(NotAMapError, match=r"uncertainties in .* cannot be used"):
        merge_files(tmp_path / "hall.map", tmp_path / "good.map", tmp_path / "both.map")


def test_maps_of_more_landmarks_than_all_pairs_of_which_fit_into_memory_are_not_merged(tmp_path: Path) -> None:
    (tmp_path / "small.map").write_bytes(map_bytes())
    (tmp_path / "large.map").write_bytes(map_bytes(2001))
    small, large = tmp_path / "small.map", tmp_path / "large.map"
    for first, second in ((small, large), (large, small)):
        with pytest.raises(UsageError, match=r"large.map has 2001 landmarks, maps to merge have at most 2000"):
            merge_files(first, second, tmp_path / "both.map")
