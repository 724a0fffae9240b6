"""Looking at a run: the rerun viewer on this machine only, and pictures of it without a screen."""

import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

from runtime.errors import ConfigurationError, StorageError
from runtime.record.folder import RunFolder
from runtime.record.reader import RunReader
from runtime.record.trajectories import with_estimates
from runtime.review.ticks import ELAPSED

LOOPBACK = "127.0.0.1"
RRD_MAGIC = b"RRF2"  # major and minor version follow, a byte each
READY_S = 60.0
POLL_S = 0.5
TOP_BAR_PX = 36
SETTLE_S = 2.0  # after the last change of time: textures and plots are drawn over a few frames
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")  # one of them is set where there is a screen
NO_SCREEN = (
    "there is no screen here (neither DISPLAY nor WAYLAND_DISPLAY is set); give --web, or --screenshot FILE.png for a "
    "recorded run, or look from a machine with a screen"
)
NO_VULKAN = (
    "the viewer has no graphics driver; install one that needs no graphics card: apt-get install mesa-vulkan-drivers"
)


def review_paths(folder: RunFolder, progress: Callable[[float], None] | None = None) -> list[Path]:
    """Files of a run's review, made from run.mcap if the last is missing; of the newest replay if it was imported.

    What a newer rerun has drawn than the viewer here is drawn again: it may not understand all of it.
    progress gets the share that is drawn. Raises NotARunError, StorageError, UsageError (an import, no replay).
    """
    folder = with_estimates(RunReader(folder.path)).folder
    if not folder.review_path.is_file() or any(map(is_of_newer_rerun, folder.review_paths())):
        from runtime.review.rebuild import build_review

        build_review(folder.path, folder.review_path, progress=progress)
    return folder.review_paths()


def is_of_newer_rerun(rrd: Path) -> bool:
    """Whether the file begins with the mark of an .rrd and a version above the one that is installed."""
    with rrd.open("rb") as stream:
        head = stream.read(6)
    installed = bytes(int(part) for part in version("rerun-sdk").split(".")[:2])
    return head.startswith(RRD_MAGIC) and head[len(RRD_MAGIC) :] > installed


def open_review(
    folder: RunFolder,
    web: bool = False,
    progress: Callable[[float], None] | None = None,
    at_s: float | None = None,
    say: Callable[[str], object] = str,
) -> int:
    """Open the viewer and wait until it is closed; with `web` serve it to a browser on this machine.

    at_s: where the native viewer stands then, s since the first tick. say: told where to look, and how it ends.
    Returns the viewer's exit code. Raises ConfigurationError when the viewer is not installed or there is no screen.
    """
    require_screen(web)
    port, web_port = free_port(), free_port() if web else None
    command = viewer_command(review_paths(folder, progress), port, web_port)
    with subprocess.Popen(command, env={"RUST_LOG": "error", **viewer_environment()}) as viewer:
        say(f"{folder.path} is shown{'' if web_port is None else f' at {page_url(port, web_port)}'}; Ctrl-C ends")
        if at_s is not None:
            from rerun.experimental import ViewerClient

            client = _loaded_client(viewer, ViewerClient, f"rerun+http://{LOOPBACK}:{port}/proxy", None, ELAPSED)
            client.set_time(ELAPSED, duration=at_s, play_state="paused")
        return viewer.wait()


def require_screen(web: bool) -> None:
    """Raises ConfigurationError for a window where there is no screen: the viewer would end in words of its own."""
    if not web and not any(map(os.environ.get, SCREENS)):
        raise ConfigurationError(NO_SCREEN)


def page_url(port: int, web_port: int) -> str:
    """Where the viewer's own web server shows what it gets at `port`."""
    return f"http://{LOOPBACK}:{web_port}?url=rerun%2Bhttp%3A%2F%2F{LOOPBACK}%3A{port}%2Fproxy"


def viewer_command(rrds: Sequence[Path], port: int, web_port: int | None = None) -> list[str]:
    """The viewer's command line: every port that it opens is one of the loopback. Raises ConfigurationError.

    web_port: where a browser finds it; None for a window.
    """
    for path in rrds:
        if os.fsencode(path) != str(path).encode(errors="replace"):
            raise ConfigurationError(f"{path}: the viewer takes only paths in UTF-8; give the run another name")
    command = [viewer_path(), *map(str, rrds), "--bind", LOOPBACK, "--port", str(port)]
    return command if web_port is None else [*command, "--web-viewer", "--web-viewer-port", str(web_port)]


def screenshot(
    folder: RunFolder,
    png: Path,
    at_s: float | None = None,
    size: tuple[int, int] = (1600, 1000),
    progress: Callable[[float], None] | None = None,
) -> list[str]:
    """Render the review of a run into a PNG without a screen, at a time of the run or at its end.

    Returns the errors that the views report, none if all is well.
    Raises ConfigurationError when there is no viewer or no driver, StorageError when the PNG cannot be written.
    """
    with headless_viewer(review_paths(folder, progress), size) as client:
        end_s = last_time_s(client.get_state())
        client.set_time(ELAPSED, duration=end_s if at_s is None else min(at_s, end_s), play_state="paused")
        time.sleep(SETTLE_S)
        try:
            client.save_screenshot(str(png.absolute()))
            without_top_bar(png)
        except (RuntimeError, OSError) as error:
            raise StorageError(f"{png} cannot be written ({error}); give a path in a folder that exists") from error
        return reported_errors(client.get_state())


def reported_errors(state: Any) -> list[str]:
    """What the views of a viewer complain of, "view: report" each."""
    return [f"{view.name}: {report}" for view in state.views for report in view.reports]


def last_time_s(state: Any, name: str = ELAPSED) -> float:
    """Where the timeline of that name ends, which counts nanoseconds; -1 while there is none."""
    ends_ns = [
        timeline.end
        for recording in state.recordings
        for timeline in recording.timelines
        if timeline.name == name and timeline.end is not None
    ]
    return max(ends_ns) * 1e-9 if ends_ns else -1.0


def without_top_bar(png: Path) -> None:
    """Cut off the menu, which in a headless viewer only warns of its own software rendering."""
    from PIL import Image

    with Image.open(png) as picture:
        cut = picture.crop((0, TOP_BAR_PX, picture.width, picture.height))
    cut.save(png, optimize=True)


def viewer_path() -> str:
    """The viewer that came with the package rerun-sdk.

    The program itself and not the command `rerun`, which would leave it running when it is ended.
    Raises ConfigurationError when it is not installed.
    """
    package = find_spec("rerun_cli")
    program = Path(package.origin).with_name("rerun") if package is not None and package.origin else None
    if program is None or not program.exists():
        raise ConfigurationError("no rerun viewer found; install the package rerun-sdk into this environment")
    return str(program)


def viewer_environment() -> dict[str, str]:
    """Without a screen only Vulkan draws; with one the viewer chooses for itself."""
    return {**os.environ, "RERUN_ANALYTICS": "off"}


def free_port() -> int:
    """A port of the loopback that was free a moment ago."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        port: int = probe.getsockname()[1]
        return port


@contextmanager
def headless_viewer(files: Sequence[Path], size: tuple[int, int], timeline: str = ELAPSED) -> Iterator[Any]:
    """A client of an invisible viewer that has loaded .rrd or .mcap files; the viewer ends with the block.

    timeline: one that counts nanoseconds, by which it is seen that all has been loaded.

    Raises ConfigurationError when it does not come up.
    """
    from rerun.experimental import ViewerClient

    port = free_port()
    command = [viewer_path(), "--headless", "--port", str(port), "--bind", LOOPBACK]
    command += ["--window-size", f"{size[0]}x{size[1]}", *map(str, files)]
    with tempfile.TemporaryFile() as words:
        environment = {**viewer_environment(), "WGPU_BACKEND": "vulkan"}
        viewer = subprocess.Popen(command, env=environment, stdout=words, stderr=words)
        try:
            yield _loaded_client(viewer, ViewerClient, f"rerun+http://{LOOPBACK}:{port}/proxy", words, timeline)
        finally:
            viewer.kill()
            viewer.wait()


def _loaded_client(
    viewer: "subprocess.Popen[bytes]", connector: Any, url: str, words: IO[bytes] | None, timeline: str
) -> Any:
    """Connect, and wait until the file is loaded and its layout has views."""
    client: Any = None
    before = -1.0
    deadline_s = time.monotonic() + READY_S
    while time.monotonic() < deadline_s:
        if viewer.poll() is not None:
            said = ""
            if words is not None:
                words.seek(0)
                said = words.read().decode(errors="replace")
            raise ConfigurationError(NO_VULKAN if "adapter" in said else f"the viewer ended: {said.strip()[-300:]}")
        try:
            client = client or connector.connect(url)
            state = client.get_state()
            end_s = last_time_s(state, timeline)
            arranged = bool(state.views) or timeline != ELAPSED  # only a review brings its layout with it
            if arranged and not state.loading and 0.0 <= end_s == before:
                return client  # nothing has been added since the last look
            before = end_s
        except (RuntimeError, ConnectionError, OSError):
            client = None  # not listening yet
        time.sleep(POLL_S)
    raise ConfigurationError(f"the viewer did not load the file within {READY_S:.0f} s; try infant view --web")
