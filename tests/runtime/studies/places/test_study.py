import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from runtime.cli.__main__ import app
from runtime.errors import UsageError
from runtime.studies.places.recordings import archive_of, prepared, recordings
from runtime.studies.places.study import PlacesStudy, run_places
from tests.support.runtime.made_recording import make_recording, make_standing_recording


def ignore(_done: int, _total: int) -> None: ...


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    make_recording(folder, "tiny_hall")
    make_standing_recording(folder, "standing")
    (folder / "no_scans").mkdir()
    (folder / "no_scans" / "no_scans.npz").write_bytes(b"not an archive")
    return folder


def test_the_page_says_of_every_recording_how_good_the_pose_was_beside_odometry(data: Path, tmp_path: Path) -> None:
    study = PlacesStudy(data, repeats=2, places=("tiny_hall", "standing"))
    result = run_places(study, tmp_path, None, ignore)
    figures = {(row["place"], row["way"], row["figure"]): row for row in result["figures"]}
    for way in ("own file", "defaults"):
        error = figures["tiny_hall", way, "published_rms_m"]
        assert 0.0 < error["whole"] < figures["tiny_hall", way, "odometry_rms_m"]["whole"]
        assert error["seeds"] == 2
        assert error["least"] <= error["mean"] <= error["most"]
        assert error["least"] != error["whole"], "a drive that leaves scans out is another one"
        assert figures["tiny_hall", way, "defects"]["most"] == 0.0
    page = (tmp_path / "places.md").read_text()
    assert "| tiny_hall | odometry alone | " in page
    assert "| standing | at rest | " in page
    asked = {(row["way"], row["figure"], row["statistic"]): row for row in result["asked"]}
    assert asked["defaults", "over_odometry", "worst"]["reached"] == "aim"
    assert asked["defaults", "error over that with the own file", "worst"]["value"] > 0.0
    assert json.loads((tmp_path / "places.json").read_text())["places"] == ["tiny_hall", "standing"]
    assert (tmp_path / "asked.csv").read_text().startswith("place,way,figure,statistic,value")


def test_simulated_places_are_driven_with_seeds_instead(data: Path, tmp_path: Path) -> None:
    study = PlacesStudy(data, repeats=1, places=("building_4hz", "drop_outs"), length=0.1)
    result = run_places(study, tmp_path, None, ignore)
    asked = {(row["place"], row["way"], row["figure"]): row for row in result["asked"]}
    assert asked["building_4hz", "defaults, simulated", "published_aligned_rms_m"]["value"] > 0.0
    for share in (5, 20, 50):
        row = asked["park", f"{share} % dropped", "landmarks over those without"]
        assert row["low"] <= row["value"] <= row["high"]
    assert "## Beams that give no return" in (tmp_path / "places.md").read_text()


def test_recordings_are_what_holds_scans_and_a_name_that_is_none_is_refused_with_those_that_are(data: Path) -> None:
    assert recordings(data) == ["standing", "tiny_hall"]
    with pytest.raises(UsageError, match="there are standing, tiny_hall, building_4hz"):
        PlacesStudy(data, 1, ("tinyhall",)).chosen()


def test_the_defaults_keep_of_a_file_its_geometry_only(data: Path) -> None:
    archive = archive_of(data, "tiny_hall")
    _, own = prepared(archive, own=True)
    _, defaults = prepared(archive, own=False)
    assert own.slam.mount.x_m == defaults.slam.mount.x_m == 0.3
    assert own.slam.odometry.model == defaults.slam.odometry.model
    assert set(defaults.model_fields_set) <= {"rover", "vehicle", "slam"}
    assert "view" not in defaults.slam.model_fields_set


def test_the_command_takes_sets_after_their_option_and_refuses_them_elsewhere(data: Path, tmp_path: Path) -> None:
    words = ["paper", "places", "--data", str(data), "--out", str(tmp_path), "--repeats", "1", "--scheduler", "none"]
    done = CliRunner().invoke(app, [*words, "--json", "--sets", "standing", "tiny_hall"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["places"] == ["standing", "tiny_hall"]
    refused = CliRunner().invoke(app, ["paper", "fig1", "seattle"])
    assert isinstance(refused.exception, UsageError)
