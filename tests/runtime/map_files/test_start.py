"""A run begins in a saved map, leaves that map as it was, and can be repeated to the last bit."""

from dataclasses import replace
from pathlib import Path

import pytest

from drivers.measurements import Event
from drivers.simulated.world.places.building import Building, building_settings
from runtime.errors import ConfigurationError, NotAMapError, UsageError
from runtime.map_files.end import end_in_map, end_lines
from runtime.map_files.map_file import encode_map
from runtime.map_files.map_store import read_map
from runtime.map_files.start import BeginIn, RunStart, choose_start, parse_pose, recorded_start
from runtime.maps.save import save_run
from runtime.messages.records import input_records
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RunWriter
from runtime.record.reader import RunReader
from runtime.replay.replay import replay_run
from runtime.settings.configuration import Configuration, load_configuration_text
from runtime.studies.places.building_drive import building_ticks
from slam.estimate import Estimate
from slam.pose import Pose2
from tests.support.runtime.small_maps import FACTS, map_bytes, small_map

LAPS = 0.05


@pytest.fixture
def hall(tmp_path: Path) -> Path:
    path = tmp_path / "hall.map"
    path.write_bytes(map_bytes())
    return path


def at(path: Path, start_at: str, text: str = "") -> RunStart:
    start = choose_start(path, False, start_at, load_configuration_text(text))
    assert start is not None
    return start


def test_without_a_map_a_run_makes_its_own() -> None:
    assert choose_start(None, False, None, Configuration()) is None
    for localise_only, start_at in ((True, None), (False, "0,0,0")):
        with pytest.raises(UsageError, match="need a map"):
            choose_start(None, localise_only, start_at, Configuration())


def test_the_map_of_the_configuration_is_begun_in(hall: Path) -> None:
    configuration = load_configuration_text(f"[map]\nfile = '{hall}'\n")
    start = choose_start(None, True, "0,0,0", configuration)
    assert start is not None
    assert start.saved.joint.digest() == small_map().digest()


@pytest.mark.parametrize("text", ["", "1,2", "1,2,3,4", "a,b,c", "nan,0,0", "1e300,0,0", "inf,0,0"])
def test_a_pose_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--start-at"):
        parse_pose(text)


def test_a_pose_outside_the_map_is_refused_with_where_the_map_is(hall: Path) -> None:
    with pytest.raises(UsageError, match=r"--start-at 500,0,0 is 4\d\d m from the nearest landmark .* x -47 to 49 m"):
        at(hall, "500,0,0")


def test_a_map_in_which_no_place_can_be_recognised_needs_a_pose(hall: Path) -> None:
    joint = small_map(5)
    hall.write_bytes(
        encode_map(replace(joint, view_poses=joint.view_poses[:0], view_points_cm=joint.view_points_cm[:0]), FACTS)
    )
    with pytest.raises(
        UsageError, match=r"hall\.map holds 5 landmarks and no view of walls, .* by 6, or by walls; give --start-at"
    ):
        choose_start(hall, True, None, Configuration())
    x_m, y_m = joint.means_m[0].tolist()
    assert at(hall, f"{x_m},{y_m},0").pose is not None
    hall.write_bytes(encode_map(joint, FACTS))  # with its views
    assert choose_start(hall, True, None, Configuration()) is not None


def test_a_map_of_another_sensor_is_refused_and_of_another_mount_taken_with_a_note(hall: Path) -> None:
    with pytest.raises(ConfigurationError, match="another kind of sensor"):
        at(hall, "0,0,0", "[slam.front_end]\nkind = 'given'\n")
    assert len(at(hall, "0,0,0").notes) == 1


def test_a_recorded_start_is_found_again_and_an_exchanged_copy_is_refused(hall: Path, tmp_path: Path) -> None:
    start = at(hall, "1.25,-3.5,0.75")
    folder = RunFolder.create(tmp_path / "run", tmp_path)
    start.keep_in(folder)
    header = RunHeader.from_metadata(RunHeader("", "live", start=start.metadata).metadata)
    again = recorded_start(header, folder)
    assert again is not None
    assert (again.pose, again.localise_only, again.saved.sha256) == (start.pose, False, start.saved.sha256)
    for changes in ({"file": None}, {"start_at": "here"}):
        told = {key: value for key, value in {**start.metadata, **changes}.items() if value is not None}
        with pytest.raises(NotAMapError, match="does not say how it started"):
            recorded_start(RunHeader("", "live", start=told), folder)
    folder.start_map_path.write_bytes(map_bytes(seed=1))
    with pytest.raises(NotAMapError, match="not the map in which the run started"):
        recorded_start(header, folder)
    folder.start_map_path.unlink()
    with pytest.raises(NotAMapError, match="cannot be replayed without it"):
        recorded_start(header, folder)
    assert recorded_start(RunHeader("", "live"), folder) is None


def test_what_a_run_adds_goes_into_a_successor_and_its_origin_is_told(hall: Path, tmp_path: Path) -> None:
    start, folder = at(hall, "0,0,0"), RunFolder.create(tmp_path / "tuesday", tmp_path)
    facts = end_in_map(small_map(41), start, Configuration(), folder)
    assert facts["sha256_before"] == facts["sha256_after"]
    grown, _ = read_map(tmp_path / "hall-2.map")
    assert grown.facts.runs == ("monday", "tuesday")
    assert grown.facts.predecessor == start.saved.sha256
    assert end_lines(facts)[1] == f"map       extended into {tmp_path}/hall-2.map: 40 landmarks before, 41 after"


def test_a_run_that_never_found_its_place_leaves_no_successor(hall: Path, tmp_path: Path) -> None:
    start, folder = at(hall, "0,0,0"), RunFolder.create(tmp_path / "run", tmp_path)
    facts = end_in_map(replace(small_map(), scans=999), start, Configuration(), folder)
    assert facts["successor"] is None
    assert "never recognised" in end_lines(facts)[-1]
    assert not (tmp_path / "hall-2.map").exists()


def test_a_successor_that_has_no_room_beside_its_map_goes_into_the_run(hall: Path, tmp_path: Path) -> None:
    start, folder = at(hall, "0,0,0"), RunFolder.create(tmp_path / "run", tmp_path)
    object.__setattr__(start, "path", tmp_path / "gone" / "hall.map")
    facts = end_in_map(small_map(41), start, Configuration(), folder)
    assert facts["successor"] == str(folder.grown_map_path)
    assert "cannot be written" in end_lines(facts)[-1]
    assert len(read_map(folder.grown_map_path)[0].joint) == 41


def test_a_map_that_somebody_changed_meanwhile_is_named(hall: Path, tmp_path: Path) -> None:
    start = choose_start(hall, True, "0,0,0", Configuration())
    assert start is not None
    folder = RunFolder.create(tmp_path / "run", tmp_path)
    assert "is unaltered" in end_lines(end_in_map(small_map(), start, Configuration(), folder))[0]
    hall.write_bytes(b"")
    assert "CHANGED" in end_lines(end_in_map(small_map(), start, Configuration(), folder))[0]


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve metres of a corridor, only what came in."""
    building = Building(building_settings(0, 541))
    mount_x_m, _, _ = building.settings.laser.body_from_laser
    text = load_configuration_text(f"[slam]\nparticles = 5\nmount.x_m = {mount_x_m}\n").text
    folder = tmp_path_factory.mktemp("drive")
    writer = RunWriter(folder / "run.mcap", RunHeader(text, "import building").metadata)
    for tick in building_ticks(building, 5.0, LAPS):
        writer.add(input_records(tick))
    writer.close()
    return folder


@pytest.fixture(scope="module")
def corridor(drive: Path) -> tuple[Path, Pose2]:
    """The map of the drive, and where the drive ends."""
    path = drive / "corridor.map"
    assert save_run(drive, path, lambda _: None)["landmarks"] > 10
    return path, ended(drive, drive / "plain", BeginIn()).map_from_body


def ended(drive: Path, out: Path, begin: BeginIn) -> Estimate:
    replay_run(drive, None, out, False, {}, begin=begin)
    estimate = [tick.estimate for tick in RunReader(out).ticks()][-1]
    assert estimate is not None
    return estimate


@pytest.mark.parametrize(("localise_only", "start_at"), [(True, "0.2,-0.1,0.02"), (True, None), (False, None)])
def test_a_replay_in_a_map_is_on_its_place_and_repeats_to_the_last_bit(
    localise_only: bool, start_at: str | None, drive: Path, corridor: tuple[Path, Pose2], tmp_path: Path
) -> None:
    path, true_end = corridor
    before, out = path.read_bytes(), tmp_path / "out"
    last = ended(drive, out, BeginIn(path, localise_only, start_at))
    assert path.read_bytes() == before == (out / "start.map").read_bytes()
    gap = true_end.inverse() @ last.map_from_body
    assert abs(gap.x_m) < 0.05
    assert abs(gap.y_m) < 0.05
    assert last.quality == "tracking"
    if localise_only and start_at is None:
        assert replay_run(out, None, None, True, {})["identical"] is True
    (out / "start.map").unlink()
    with pytest.raises(NotAMapError):
        replay_run(out, None, None, True, {})


def test_the_map_of_a_run_that_never_found_its_place_is_not_saved_as_its_own(
    drive: Path, hall: Path, tmp_path: Path
) -> None:
    run, out = tmp_path / "run", tmp_path / "run.map"
    ended(drive, run, BeginIn(hall))
    with pytest.raises(UsageError, match=r"run added nothing to the map that it started in: .*; use hall\.map"):
        save_run(run, out, lambda _: None)
    assert not out.exists()


def recognised_ns(run: Path) -> int:
    """Stamp of the first recognition."""
    estimates = [tick.estimate for tick in RunReader(run).ticks()]
    found = (estimate for estimate in estimates if estimate and "recognised_map_id" in estimate.counts)
    return next(found).stamp_ns


@pytest.mark.parametrize("off_m", [0.0, 0.4])
def test_a_pose_that_was_given_on_the_way_is_looked_for_and_repeats_to_the_last_bit(
    off_m: float, drive: Path, corridor: tuple[Path, Pose2], tmp_path: Path
) -> None:
    """The drive begins at the map's origin, and a command in its record says so, up to off_m."""
    path, true_end = corridor
    reader, told = RunReader(drive), tmp_path / "told"
    told.mkdir()
    writer = RunWriter(told / "run.mcap", RunHeader(reader.header.configuration_text, "import building").metadata)
    for number, recorded in enumerate(reader.ticks()):
        tick = recorded.tick
        if number == 3:
            said = Event(tick.stamp_ns, "command", "initial_pose", f"{off_m},{-off_m},0.1")
            tick = replace(tick, events=(*tick.events, said))
        writer.add(input_records(tick))
    writer.close()
    out = tmp_path / "out"
    last = ended(told, out, BeginIn(path, True, None))
    gap = true_end.inverse() @ last.map_from_body
    assert max(abs(gap.x_m), abs(gap.y_m)) < 0.05
    alone = tmp_path / "alone"
    ended(drive, alone, BeginIn(path, True, None))
    assert recognised_ns(out) < recognised_ns(alone)
    assert replay_run(out, None, None, True, {})["identical"] is True
