"""The command line as a person uses it: real processes, real bytes, real files."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from runtime.source_tree import ROOT

MOCK = ROOT / "config" / "mock.toml"
DURATION_S = 30
QUIET = ("--set", "review.live=false", "--set", "publish.listen=['tcp/127.0.0.1:0']")


def infant(*words: str | Path, timeout: float = 600) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "runtime.cli", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, cwd=ROOT, check=False)


def start_run(out: Path, *words: str) -> subprocess.Popen[str]:
    command = [
        sys.executable,
        "-m",
        "runtime.cli",
        "run",
        "--config",
        str(MOCK),
        "--out",
        str(out),
        *QUIET,
        *words,
    ]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)


def await_size(path: Path, size: int, process: subprocess.Popen[str]) -> None:
    """Wait on a condition with a deadline."""
    deadline = time.monotonic() + 600
    while not path.exists() or path.stat().st_size < size:
        assert time.monotonic() < deadline, f"{path} did not reach {size} bytes"
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    """One short run of the simulated rover, with everything on; a busy machine may not finish the picture in time."""
    out = tmp_path_factory.mktemp("runs") / "run"
    result = infant("run", "--config", MOCK, "--out", out, "--duration", f"{DURATION_S}", "--seed", "4", "--json")
    assert result.returncode == 0, result.stderr
    assert (out / "review.rrd").exists() != ("review.rrd was not finished in time" in result.stderr)
    return out, json.loads(result.stdout)


def test_a_run_prints_one_json_object_with_the_promised_keys(driven: tuple[Path, dict[str, object]]) -> None:
    out, summary = driven
    promised = {"run", "ticks", "missed", "rate_hz", "lateness_ms", "odometry_rms_m", "slam_rms_m", "landmarks"}
    assert promised <= summary.keys()
    assert isinstance(summary["lateness_ms"], dict)
    assert set(summary["lateness_ms"]) == {"p50", "p99", "max"}
    # the start is part of the duration, and so are two seconds in which all is closed
    assert 0 < summary["ticks"] + summary["missed"] <= 10 * (DURATION_S - 2)  # type: ignore[operator]
    assert json.loads((out / "summary.json").read_text()) == summary
    assert {path.name for path in out.iterdir()} >= {"run.mcap", "config.toml", "summary.json"}


def test_the_rover_is_tracked_and_the_seed_reaches_filter_and_world(driven: tuple[Path, dict[str, object]]) -> None:
    out, summary = driven
    assert summary["slam_rms_m"] < 0.1  # type: ignore[operator]
    assert summary["landmarks"] > 5  # type: ignore[operator]
    text = (out / "config.toml").read_text()
    assert text.count("seed = 4") == 2


def test_a_replay_equals_the_run_to_the_last_bit(driven: tuple[Path, dict[str, object]]) -> None:
    result = infant("replay", driven[0], "--verify", "--json")
    assert result.returncode == 0, result.stdout + result.stderr
    verified = json.loads(result.stdout)
    assert verified["identical"] is True
    assert verified["compared"] == driven[1]["ticks"]


def test_another_configuration_replays_into_a_folder_of_its_own(
    driven: tuple[Path, dict[str, object]], tmp_path: Path
) -> None:
    words = ("--set", "slam.particles=20", "--without", "difference", "--out", tmp_path / "other")
    result = infant("replay", driven[0], *words, "--json")
    assert result.returncode == 0, result.stderr
    text = (tmp_path / "other" / "config.toml").read_text()
    assert "particles = 20" in text
    assert "difference = false" in text
    page = json.loads(infant("review", tmp_path / "other", "--json").stdout)
    replayed = json.loads(result.stdout)
    assert page["timing"]["stages_ms"]["step"] == replayed["step_ms"]
    assert (page["timing"]["ticks"], page["landmarks"]["at_end"]) == (replayed["ticks"], replayed["landmarks"])
    again = infant("replay", tmp_path / "other", "--verify", "--json")
    assert json.loads(again.stdout)["identical"] is True


def test_evaluation_knows_the_simulators_truth(driven: tuple[Path, dict[str, object]]) -> None:
    figures = json.loads(infant("evaluate", driven[0], "--json").stdout)
    assert figures["rms_m"] == pytest.approx(driven[1]["slam_rms_m"], abs=2e-4)
    assert figures["relation_translation_m"] is None
    assert (driven[0] / "trajectory.tum").exists()


def test_the_page_of_a_review_shows_the_figures_that_the_console_has_shown(
    driven: tuple[Path, dict[str, object]], tmp_path: Path
) -> None:
    summary = driven[1]
    words = ("--out", tmp_path / "report.html", "--json")
    page = json.loads(infant("review", driven[0], *words).stdout)
    assert (page["timing"]["ticks"], page["timing"]["missed"]) == (summary["ticks"], summary["missed"])
    assert page["timing"]["lateness_ms"] == summary["lateness_ms"]
    assert page["timing"]["stages_ms"] == summary["stages_ms"]
    assert page["timing"]["rate_hz"] == pytest.approx(summary["rate_hz"], abs=1e-3)
    assert page["landmarks"]["at_end"] == summary["landmarks"]
    for name, of_the_run in (("rms_m", "slam_rms_m"), ("odometry_rms_m", "odometry_rms_m"), ("max_m", "slam_max_m")):
        assert f"{page['accuracy'][name]:.3f}" == f"{summary[of_the_run]:.3f}", name
    drawn = json.loads(infant("map", "draw", driven[0], "--out", tmp_path / "map", "--json").stdout)
    assert page["landmarks"]["confirmed"] == drawn["landmarks"] <= page["landmarks"]["published"]
    assert f"<b>{summary['landmarks']}</b><span>landmarks</span>" in (tmp_path / "report.html").read_text()


def test_a_run_that_ends_before_its_first_tick_says_so_and_leaves_no_folder(tmp_path: Path) -> None:
    result = infant("run", "--config", MOCK, "--out", tmp_path / "run", "--duration", "0.1", "--json")
    assert result.returncode == 2
    assert "over before the first tick" in json.loads(result.stdout)["error"]["reason"]
    process = start_run(tmp_path / "run", "--json")
    await_size(tmp_path / "run" / "config.toml", 100, process)
    process.send_signal(signal.SIGINT)
    stdout, stderr = process.communicate(timeout=600)
    assert process.returncode == 130, stderr
    assert "nothing was recorded" in json.loads(stdout)["error"]["reason"]
    assert not (tmp_path / "run").exists()


def test_an_existing_run_is_never_overwritten(driven: tuple[Path, dict[str, object]]) -> None:
    before = (driven[0] / "run.mcap").read_bytes()
    result = infant("run", "--config", MOCK, "--out", driven[0], "--duration", "1")
    assert result.returncode == 6
    assert "never overwritten" in result.stderr
    assert (driven[0] / "run.mcap").read_bytes() == before


def test_ctrl_c_ends_a_run_cleanly_and_keeps_everything(tmp_path: Path) -> None:
    process = start_run(tmp_path / "run", "--json")
    await_size(tmp_path / "run" / "run.mcap", 100_000, process)
    process.send_signal(signal.SIGINT)
    stdout, stderr = process.communicate(timeout=600)
    assert process.returncode == 0, stderr
    summary = json.loads(stdout)
    verified = json.loads(infant("replay", tmp_path / "run", "--verify", "--json").stdout)
    assert (verified["identical"], verified["compared"]) == (True, summary["ticks"])
    assert verified["truncated"] is None


def test_a_killed_run_replays_to_its_last_whole_tick_and_leaves_no_process(tmp_path: Path) -> None:
    process = start_run(tmp_path / "run")
    await_size(tmp_path / "run" / "run.mcap", 150_000, process)
    children = [int(word) for word in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()]
    assert children
    process.kill()
    process.communicate(timeout=600)
    result = infant("replay", tmp_path / "run", "--verify", "--json")
    verified = json.loads(result.stdout)
    assert result.returncode == 0, result.stderr
    assert verified["identical"] is True
    assert verified["compared"] >= 5
    assert "is incomplete" in verified["truncated"]
    deadline = time.monotonic() + 600
    while any(Path(f"/proc/{child}").exists() for child in children):
        assert time.monotonic() < deadline, "the simulated rover outlived its parent"
        time.sleep(0.05)


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (("run", "--config", "nowhere.toml"), 3, "nowhere.toml"),
        (("run", "--config", MOCK, "--set", "slam.particels=5"), 3, "did you mean particles?"),
        (("run", "--config", MOCK, "--set", "slam.particles"), 2, "KEY=VALUE"),
        (("run", "--config", MOCK, "--duration", "inf"), 2, "--duration"),
        (("page", "--duration", "1e300"), 2, "--duration"),
        (("check", "--config", ROOT / "README.md"), 3, "not valid TOML"),
        (("replay", "nowhere"), 6, "nowhere does not exist"),
        (("replay", ROOT / "config"), 6, "is not a run"),
        (("replay", "nowhere", "--without", "magic"), 2, "expected one of difference"),
        (("import", ROOT / "config", "--out", "nowhere"), 3, "config"),
        (("sim",), 2, "--config"),
        (("sim", "--laser-only", "--listen", "here"), 2, "HOST:PORT"),
        (("sim", "--laser-only", "--model", "UTM-99"), 3, "UTM-30LX"),
    ],
)
def test_bad_input_is_one_sentence_and_its_exit_code(words: tuple[str | Path, ...], code: int, sentence: str) -> None:
    result = infant(*words)
    assert result.returncode == code, result.stderr
    assert sentence in result.stderr
    assert "Traceback" not in result.stderr
    assert not (ROOT / "nowhere").exists()


def test_the_help_of_every_command_fits_a_screen() -> None:
    commands = ("run", "sim", "check", "replay", "import", "evaluate", "review", "view", "warmup")
    for command in commands:
        text = infant(command, "--help").stdout
        assert text.strip()
        assert len(text.splitlines()) <= 50, command


def test_the_simulated_laser_alone_prints_where_it_is_and_ends_on_sigterm() -> None:
    command = [sys.executable, "-m", "runtime.cli", "sim", "--laser-only", "--listen", "127.0.0.1:0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT, env=os.environ)
    assert process.stdout is not None
    assert process.stdout.readline().startswith("laser  tcp://127.0.0.1:")
    process.terminate()
    assert process.wait(240) == 0
    process.stdout.close()
