"""Installing shows what it would do, does it once, keeps what an engineer wrote, and can be undone."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.settings.can import BusSettings
from drivers.wheels.layouts.choose import ROVER_DBC
from runtime.errors import ConfigurationError, PreflightError, StorageError
from runtime.settings.configuration import load_configuration
from runtime.setup import install
from runtime.setup.install import CONFIGURATION, PLACES, SHIPPED_PROGRAM, Command, FileState, Plan
from runtime.setup.place import place_trouble
from runtime.source_tree import CONFIG, ROOT
from tests.support.runtime.measured import VEHICLE

UNIT = "etc/systemd/system/infant.service"
COUNT = len(PLACES) + 1


def states(plan: Plan) -> dict[str, FileState]:
    return {each.path.name: each.state for each in plan.files}


def installed(root: Path) -> list[Command]:
    ran: list[Command] = []
    install.apply(install.plan_install(root, SHIPPED_PROGRAM), ran.append)
    return ran


def test_a_plan_changes_nothing_and_names_every_file_and_command(tmp_path: Path) -> None:
    plan = install.plan_install(tmp_path, SHIPPED_PROGRAM)
    assert not list(tmp_path.iterdir())
    lines = install.plan_lines(plan)
    for place in (*PLACES.values(), CONFIGURATION):
        assert any(line.startswith("new") and line.endswith(str(tmp_path / place)) for line in lines)
    for command in plan.commands:
        assert f"run       {' '.join(command)}" in lines
    assert [command[0] for command in plan.commands] == ["systemd-sysusers", "systemd-tmpfiles", "systemctl"]


def test_the_second_time_nothing_is_left_to_write(tmp_path: Path) -> None:
    installed(tmp_path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    assert set(states(install.plan_install(tmp_path, SHIPPED_PROGRAM)).values()) == {FileState.UNCHANGED}
    installed(tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()} == before
    assert len(before) == COUNT


def test_a_unit_that_differs_is_shown_line_by_line_and_replaced(tmp_path: Path) -> None:
    installed(tmp_path)
    unit = tmp_path / UNIT
    unit.write_text(unit.read_text().replace("WatchdogSec=2s", "WatchdogSec=9s"))
    plan = install.plan_install(tmp_path, SHIPPED_PROGRAM)
    assert states(plan)["infant.service"] is FileState.DIFFERS
    lines = [line.strip() for line in install.plan_lines(plan)]
    assert "-WatchdogSec=9s" in lines
    assert "+WatchdogSec=2s" in lines
    installed(tmp_path)
    assert "WatchdogSec=2s" in unit.read_text()


def test_an_edited_configuration_is_kept_and_told_so(tmp_path: Path) -> None:
    installed(tmp_path)
    mine = tmp_path / CONFIGURATION
    mine.write_text('rover = "field-2"\n' + mine.read_text())
    plan = install.plan_install(tmp_path, SHIPPED_PROGRAM)
    assert states(plan)["rover.toml"] is FileState.KEPT
    assert any("never overwritten" in note for note in plan.notes)
    installed(tmp_path)
    assert 'rover = "field-2"' in mine.read_text()
    install.apply(install.plan_removal(tmp_path, SHIPPED_PROGRAM), lambda command: None)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [mine]


def test_a_configuration_that_cannot_be_used_stops_it_before_anything_is_written(tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text("[laser]\nurl = 7\n")
    root = tmp_path / "root"
    with pytest.raises(ConfigurationError, match=r"bad\.toml: laser\.url = 7: expected text"):
        install.plan_install(root, SHIPPED_PROGRAM, bad)
    (root / "etc" / "infant").mkdir(parents=True)
    (root / CONFIGURATION).write_text("[loop]\nrate = 10\n")
    with pytest.raises(ConfigurationError, match=r"rover\.toml: loop\.rate = 10: unknown key; did you mean rate_hz"):
        install.plan_install(root, SHIPPED_PROGRAM)
    assert [path for path in root.rglob("*") if path.is_file()] == [root / CONFIGURATION]


def test_a_rover_whose_can_nobody_brings_up_is_told_how_with_its_own_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(install, "_is_active", lambda unit: False)
    notes = install._live_notes(BusSettings(interface="socketcan", channel="can1", bitrate=250_000))
    assert "bring can1 up after each boot: sudo ip link set can1 up type can bitrate 250000 restart-ms 100" in notes[0]
    assert not any("networkd" in note for note in install._live_notes(BusSettings(interface="slcan", channel="/dev/x")))


def test_units_start_the_program_from_where_it_is(tmp_path: Path) -> None:
    plan = install.plan_install(tmp_path, Path("/srv/rover/venv/bin/infant"))
    for name, words in (("infant.service", "run --config /etc/infant/rover.toml"), ("infant-warmup.service", "warmup")):
        text = next(each.text for each in plan.files if each.path.name == name)
        assert f"ExecStart=/srv/rover/venv/bin/infant {words}" in text.splitlines()
        assert "/opt/infant" not in text


def test_a_removal_takes_its_own_files_and_says_what_stays(tmp_path: Path) -> None:
    installed(tmp_path)
    ran: list[Command] = []
    plan = install.plan_removal(tmp_path, SHIPPED_PROGRAM)
    install.apply(plan, ran.append)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
    assert ran == [("systemctl", f"--root={tmp_path}", "disable", "infant.service")]
    assert any("runs in /var/lib/infant" in note for note in plan.notes)
    again = install.plan_removal(tmp_path, SHIPPED_PROGRAM)
    assert set(states(again).values()) == {FileState.ABSENT}
    assert not again.before


def test_a_command_that_fails_ends_it_with_what_the_command_said() -> None:
    with pytest.raises(PreflightError, match=r"sh -c .*: the words; fix that and run infant install again"):
        install.execute(("sh", "-c", "echo the words >&2; exit 3"))
    with pytest.raises(PreflightError, match="the service needs systemd"):
        install.execute(("no-such-program-anywhere",))


def test_a_folder_that_refuses_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "etc").write_text("a file where a folder should be")
    with pytest.raises(StorageError, match=r"cannot be written \(.*\); check the mount"):
        installed(tmp_path)


@pytest.mark.parametrize("link", ["etc", "etc/systemd", "etc/systemd/system", UNIT, "etc/infant", CONFIGURATION])
@pytest.mark.parametrize("is_relative", [False, True])
def test_no_link_of_an_image_leads_out_of_it(tmp_path: Path, link: str, is_relative: bool) -> None:
    root, victim = tmp_path / "image", tmp_path / "victim"
    victim.mkdir()
    (root / link).parent.mkdir(parents=True)
    (root / link).symlink_to(os.path.relpath(victim, (root / link).parent) if is_relative else victim)
    for plan in (install.plan_install, install.plan_removal):
        with pytest.raises(StorageError, match=r"leads through a link to .*, which is not in the image"):
            plan(root, SHIPPED_PROGRAM)
    assert not any(victim.iterdir())


def test_a_link_within_an_image_is_followed(tmp_path: Path) -> None:
    (tmp_path / "usr" / "etc").mkdir(parents=True)
    (tmp_path / "etc").symlink_to("usr/etc")
    installed(tmp_path)
    assert (tmp_path / "usr" / UNIT).is_file()


def test_a_unit_that_is_a_pipe_or_endless_is_one_sentence(tmp_path: Path) -> None:
    unit = tmp_path / UNIT
    unit.parent.mkdir(parents=True)
    os.mkfifo(unit)
    with pytest.raises(StorageError, match="not a regular file"):
        install.plan_install(tmp_path, SHIPPED_PROGRAM)
    unit.unlink()
    with unit.open("wb") as stream:
        stream.truncate(1 << 34)
    with pytest.raises(StorageError, match="more than the"):
        install.plan_removal(tmp_path, SHIPPED_PROGRAM)


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """A program in a place as good as /opt/infant."""
    tmp_path.chmod(0o755)
    path = tmp_path / "opt" / "infant" / "bin" / "infant"
    path.parent.mkdir(parents=True)
    path.touch()
    for each in (path, *list(path.parents)[:3]):
        each.chmod(0o755)
    return path


def test_a_program_in_the_open_can_be_a_service(program: Path, tmp_path: Path) -> None:
    assert place_trouble(program, (program.parent,), root=tmp_path) == ""


@pytest.mark.parametrize("hidden", ["home", "root", "tmp", "run/user"])
def test_an_interpreter_out_of_the_services_sight_is_named(program: Path, tmp_path: Path, hidden: str) -> None:
    interpreter = tmp_path / hidden / "python3"
    interpreter.parent.mkdir(parents=True, exist_ok=True)
    interpreter.touch()
    link = program.with_name("python")
    link.symlink_to(interpreter)
    trouble = place_trouble(program, (link,), root=tmp_path)
    assert f"{interpreter} is below /{hidden}, which the service cannot see; clone to /opt/infant" in trouble


def test_a_folder_that_only_its_owner_may_read_is_named(program: Path, tmp_path: Path) -> None:
    program.parents[1].chmod(0o700)
    assert f"{program.parents[1]} is not readable by everyone" in place_trouble(program, (), root=tmp_path)


def test_a_path_that_a_unit_would_misread_is_refused(tmp_path: Path) -> None:
    assert "cannot be named in a unit" in place_trouble(tmp_path / "my rover" / "infant", (), root=tmp_path)


@pytest.mark.skipif(shutil.which("systemd-sysusers") is None, reason="systemd is not installed (package systemd)")
def test_the_command_line_installs_into_an_image_twice_and_takes_it_away(tmp_path: Path) -> None:
    def infant(*words: str) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, "-m", "runtime.cli", "install", "--root", str(tmp_path), "--json", *words]
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)

    dry = infant("--dry-run")
    assert dry.returncode == 0, dry.stderr
    assert {each["state"] for each in json.loads(dry.stdout)["files"]} == {"new"}
    assert not list(tmp_path.iterdir())
    for state in ("new", "unchanged"):
        done = infant()
        assert done.returncode == 0, done.stderr
        assert {each["state"] for each in json.loads(done.stdout)["files"]} == {state}
    assert (tmp_path / "etc/systemd/system/multi-user.target.wants/infant.service").is_symlink()
    assert "infant:x:" in (tmp_path / "etc/passwd").read_text()
    assert infant("--remove").returncode == 0
    assert not (tmp_path / UNIT).exists()
    assert not (tmp_path / "etc/systemd/system/multi-user.target.wants/infant.service").is_symlink()


def test_a_machine_that_cannot_be_installed_into_is_refused_with_code_4(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "runtime.cli", "install", "--root", str(tmp_path / "nowhere")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 4
    assert "is not a folder; give the root of an image" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_dbc_of_a_configuration_goes_with_it(tmp_path: Path) -> None:
    folder, root = tmp_path / "mine", tmp_path / "root"
    (folder / "maker").mkdir(parents=True)
    root.mkdir()
    shutil.copy(ROVER_DBC, folder / "maker" / "wheels.dbc")
    source = folder / "rover.toml"
    layout = '[laser]\n[encoders.bus]\nport = 1\n[encoders.layout]\nkind = "dbc"\nfile = "maker/wheels.dbc"\n'
    source.write_text(VEHICLE + "[slam.mount]\nx_m = 0.2\n" + layout)
    install.apply(install.plan_install(root, SHIPPED_PROGRAM, source), lambda _command: None)
    assert (root / "etc/infant/maker/wheels.dbc").read_bytes() == ROVER_DBC.read_bytes()
    there = load_configuration(root / CONFIGURATION).encoders
    assert there is not None
    assert getattr(there.layout, "file", None) == str((root / "etc/infant/maker/wheels.dbc").resolve())
    source.write_text(source.read_text().replace("maker/", "../mine/maker/"))
    with pytest.raises(ConfigurationError, match="next to the configuration"):
        install.plan_install(tmp_path / "mine", SHIPPED_PROGRAM, source)


def test_the_bus_is_brought_up_with_the_name_and_the_bit_rate_of_the_configuration(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    text = (CONFIG / "rover.toml").read_text(encoding="utf-8")
    mine.write_text(text.replace("[encoders.bus]", "[encoders.bus]\nbitrate = 250000").replace('"can0"', '"can1"'))
    plan = install.plan_install(tmp_path / "root", SHIPPED_PROGRAM, mine)
    network = next(each.text for each in plan.files if each.path.name == "80-can0.network").splitlines()
    assert {"Name=can1", "BitRate=250000"} <= set(network)
    install.apply(plan, lambda command: None)
    kept = install.plan_install(tmp_path / "root", SHIPPED_PROGRAM)
    assert states(kept)["80-can0.network"] is FileState.UNCHANGED
