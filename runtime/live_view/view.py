"""infant view --live: a viewer on this machine, drawn into from what a rover says over zenoh."""

import socket
import subprocess
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from runtime.errors import ConfigurationError, StorageError
from runtime.live_view.ticks import HEARD, LiveTicks, path_of
from runtime.publish.find_rover import FoundRover, find_rover
from runtime.publish.follow import Follower, Message, following
from runtime.publish.session import LARGEST_ANSWER
from runtime.review.viewer import LOOPBACK, free_port, page_url, require_screen, viewer_environment, viewer_path
from runtime.review.writer import ReviewWriter
from runtime.settings.configuration import load_configuration_text
from runtime.settings.review import ReviewSettings
from slam.settings.slam import MountSettings

WAKE_S = 0.1
MAP_S = 1.0  # from one question for the landmarks to the next
READY_S = 30.0


def view_live(
    connect: str | None,
    rover: str | None,
    config_file: str | None,
    web: bool,
    stop: threading.Event,
    tell: Callable[[str], None],
) -> int:
    """Until the viewer is closed or `stop`; returns the viewer's exit code, 0 where it was ended from here.

    tell: told what is shown, and with `web` where. The viewer's own words of that are left out.
    Raises SensorError where no rover answers, UsageError, ConfigurationError where there is no viewer or no screen.
    """
    found = find_rover(connect, rover, config_file)
    require_screen(web)
    port, web_port = free_port(), free_port()
    command = [viewer_path(), "--bind", LOOPBACK, "--port", str(port)]
    command += ["--web-viewer", "--web-viewer-port", str(web_port)] if web else []
    viewer = subprocess.Popen(command, env={**viewer_environment(), "RUST_LOG": "error"})
    try:
        _await(port, viewer)
        tell(f"{found.name} is shown{f' at {page_url(port, web_port)}' if web else ''}; Ctrl-C ends")
        draw_live(found, config_file, f"rerun+http://{LOOPBACK}:{port}/proxy", lambda: viewer.poll() is None, stop)
        return viewer.poll() or 0
    finally:
        viewer.terminate()
        viewer.wait()


def draw_live(
    rover: FoundRover, config_file: str | None, url: str, is_open: Callable[[], bool], stop: threading.Event
) -> int:
    """Draw into a viewer until it is closed or `stop`; returns how many ticks. A rover that comes again begins anew."""
    drawn, writer, ticks, next_map_s = 0, None, LiveTicks(rover.name), 0.0
    with following(rover, HEARD, config_file) as follower:
        while is_open() and not stop.is_set():
            if follower.has_come():
                _close(writer)
                writer, ticks = _begin(follower, url), LiveTicks(rover.name)
            message = follower.next(WAKE_S)
            assembled = None if message is None else ticks.take(message)
            if writer is None or assembled is None:
                continue
            writer.draw(assembled)
            drawn += 1
            if time.monotonic() >= next_map_s:
                next_map_s = time.monotonic() + MAP_S
                ticks.take(Message("map", follower.ask("map", LARGEST_ANSWER) or b"{}"))
        _close(writer)
    return drawn


def _close(writer: ReviewWriter | None) -> None:
    """A viewer that has been closed, by Ctrl-C for example, takes no more; nothing is lost by that."""
    if writer is not None:
        with suppress(StorageError):
            writer.close()


def _begin(follower: Follower, url: str) -> ReviewWriter:
    """A recording with what the rover has driven and seen so far."""
    mount = MountSettings()
    text, path = follower.ask("configuration"), follower.ask("path")
    with suppress(ConfigurationError, UnicodeDecodeError):
        source = f"configuration of {follower.rover}"
        mount = load_configuration_text((text or b"").decode(), source=source).slam.mount
    began = f"{time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime())}"
    facts = {"run": f"{follower.rover} live {began}", "rover": follower.rover}
    writer = ReviewWriter(Path("live"), ReviewSettings(), mount, facts, viewer_url=url)
    with suppress(ValueError):
        if path:
            writer.draw_before(path_of(path))
    return writer


def _await(port: int, viewer: "subprocess.Popen[bytes]") -> None:
    """Wait until a viewer listens. Raises ConfigurationError."""
    deadline_s = time.monotonic() + READY_S
    while time.monotonic() < deadline_s and viewer.poll() is None:
        with suppress(OSError), socket.create_connection((LOOPBACK, port), 1.0):
            return
        time.sleep(WAKE_S)
    raise ConfigurationError("the viewer does not start here; try --web, or infant page on the rover")
