"""A run opens in the viewer without errors, the right way round, and on this machine only."""

import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from runtime.errors import ConfigurationError
from runtime.live.drawing_process import ReviewProcess
from runtime.record.folder import RunFolder
from runtime.record.header import RunHeader
from runtime.record.mcap_file import RecordFile
from runtime.review.layout import SLAM
from runtime.review.viewer import (
    RRD_MAGIC,
    SCREENS,
    free_port,
    headless_viewer,
    is_of_newer_rerun,
    open_review,
    reported_errors,
    require_screen,
    review_paths,
    screenshot,
    viewer_command,
    viewer_environment,
)
from runtime.settings.review import ReviewSettings
from tests.runtime.review.test_rebuild import Drawn
from tests.support.runtime.drawn_drive import MOUNT, drive
from tests.support.zenoh.wire import until

VIEWS = {"events", "legend"}
CAPTION = re.compile(r"\d+ m driven \| .*a square is \d+ m")
CONFIGURATION = "[slam.mount]\nx_m = 0.3\n"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, patient_drawing: None) -> RunFolder:
    """A recorded run of 12 s with its review."""
    folder = RunFolder.create(tmp_path_factory.mktemp("runs") / "run", Path())
    file = RecordFile(folder.mcap_path, RunHeader(CONFIGURATION, "live").metadata)
    review = ReviewProcess(folder.review_path, ReviewSettings(), MOUNT)
    for tick in drive(120):
        for record in tick:
            file.add(record)
            review.feed(record)
    file.finish()
    file.write()
    file.close()
    review.close()
    assert review.health().trouble == ""
    return folder


def colored(png: Path, color: tuple[int, int, int], tolerance: int = 30) -> NDArray[np.float64]:
    """Places (N, 2) of the pixels of about this colour, column and row as shares of the picture."""
    with Image.open(png) as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    rows, columns = np.nonzero(np.abs(pixels - np.array(color)).max(axis=2) < tolerance)
    return np.stack((columns / pixels.shape[1], rows / pixels.shape[0]), axis=-1)


@pytest.mark.browser
def test_the_map_is_seen_from_above_with_north_up(run: RunFolder, tmp_path: Path) -> None:
    """The drive begins south of the map's middle and goes east, then north."""
    assert screenshot(run, tmp_path / "start.png", at_s=6.0) == []
    assert screenshot(run, tmp_path / "end.png") == []
    start, end = (
        places[places[:, 0] < 0.5] for places in (colored(tmp_path / name, SLAM) for name in ("start.png", "end.png"))
    )
    assert len(start) > 100
    assert end[:, 0].max() > start[:, 0].max() + 0.02, "it went east: to the right"
    assert end[:, 1].min() < start[:, 1].min() - 0.02, "it went north: upwards"


@pytest.mark.browser
def test_every_view_is_there_and_reports_no_error(run: RunFolder) -> None:
    with headless_viewer(review_paths(run), (1200, 800)) as client:
        state = client.get_state()
    names = {view.name for view in state.views}
    assert names >= VIEWS
    assert any(CAPTION.fullmatch(name) for name in names), names
    assert reported_errors(state) == []


@pytest.mark.browser
def test_the_viewer_in_the_browser_listens_on_the_loopback_only(run: RunFolder) -> None:
    environment = {**viewer_environment(), "BROWSER": "true"}  # a browser that does nothing
    viewer = subprocess.Popen(viewer_command(review_paths(run), free_port(), free_port()), env=environment)
    try:
        assert until(lambda: len(listening_addresses(viewer.pid)) >= 2)
        assert set(listening_addresses(viewer.pid)) == {"0100007F"}
    finally:
        viewer.kill()
        viewer.wait()


def listening_addresses(pid: int) -> list[str]:
    """Addresses, as /proc writes them, on which this process listens for TCP."""
    sockets = set()
    for fd in Path(f"/proc/{pid}/fd").iterdir():
        try:
            target = os.readlink(fd)
        except OSError:
            continue  # closed in between
        sockets.add(target.removeprefix("socket:[").removesuffix("]"))
    lines = Path("/proc/net/tcp").read_text().splitlines()[1:] + Path("/proc/net/tcp6").read_text().splitlines()[1:]
    fields = [line.split() for line in lines]
    return [each[1].split(":")[0] for each in fields if each[3] == "0A" and each[9] in sockets]


def test_a_missing_review_is_made_from_the_record(run: RunFolder) -> None:
    before = Drawn(run.review_path)
    run.review_path.unlink()
    assert review_paths(run) == [run.review_path]
    assert (
        Drawn(run.review_path).values[("/map/laser/kept", "positions")]
        == before.values[("/map/laser/kept", "positions")]
    )
    assert not list(run.path.glob("*.unfinished"))


def test_what_a_newer_rerun_has_drawn_is_drawn_again_by_this_one(run: RunFolder) -> None:
    assert not is_of_newer_rerun(review_paths(run)[0])
    content = bytearray(run.review_path.read_bytes())
    content[len(RRD_MAGIC) + 1] += 1  # the minor version
    run.review_path.write_bytes(content)
    assert is_of_newer_rerun(run.review_path)
    assert review_paths(run) == [run.review_path]
    assert not is_of_newer_rerun(run.review_path)
    assert len(Drawn(run.review_path).values[("/map/rover", "translation")]) == 120


def test_a_path_that_is_not_utf_8_is_one_sentence_before_the_viewer_ends_over_it() -> None:
    pytest.importorskip("rerun", reason="rerun is not installed")
    viewer_command([Path("köln/review.rrd")], 9876)
    with pytest.raises(ConfigurationError, match="only paths in UTF-8"):
        viewer_command([Path(os.fsdecode(b"b\xe4d/review.rrd"))], 9876)


def test_no_viewer_is_one_sentence(run: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("runtime.review.viewer.find_spec", lambda name: None)
    with pytest.raises(ConfigurationError, match="install the package rerun-sdk"):
        viewer_command(review_paths(run), 9876)


def test_no_screen_is_one_sentence_that_says_what_works_without(
    run: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in SCREENS:
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(ConfigurationError, match=r"no screen here .*; give --web, or --screenshot FILE\.png"):
        open_review(run)
    require_screen(web=True)
    monkeypatch.setenv("DISPLAY", ":0")
    require_screen(web=False)


def test_a_person_is_told_where_the_browser_has_to_look(run: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("runtime.review.viewer.viewer_path", lambda: "true")
    told: list[str] = []
    assert open_review(run, web=True, say=told.append) == 0
    assert [re.sub(r"\d{4,}", "PORT", line) for line in told] == [
        f"{run.path} is shown at http://127.0.0.1:PORT?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3APORT%2Fproxy; Ctrl-C ends"
    ]


@pytest.mark.browser
def test_no_viewer_stays_behind(run: RunFolder) -> None:
    with headless_viewer(review_paths(run), (800, 600)):
        assert viewers_of(run) == 1
    assert viewers_of(run) == 0


def viewers_of(run: RunFolder) -> int:
    """Processes whose command line names this run's review."""
    name = str(run.review_path).encode()
    return sum(name in command_line(process).split(b"\0") for process in Path("/proc").glob("[0-9]*"))


def command_line(process: Path) -> bytes:
    try:
        return (process / "cmdline").read_bytes()
    except OSError:
        return b""  # it has ended in between
