"""A real Chromium shows the page on the screen of a phone: `make browser`."""

import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from runtime.source_tree import ROOT
from tests.support.browser import PHONE, TOO_WIDE, browser, needs_chromium
from tests.support.zenoh.wire import free_port, opened, publishing, put_ticks, settings_on, until

pytestmark = [pytest.mark.browser, needs_chromium]
SHOWN = ("r1", "uncertain by", "GB free")
TEXT = "document.body?.innerText ?? ''"
BOTTOMS = "['state', 'reasons', 'map', 'pose'].map((id) => document.getElementById(id).getBoundingClientRect().bottom)"


def listens(port: int) -> bool:
    with socket.socket() as client:
        return client.connect_ex(("127.0.0.1", port)) == 0


def test_a_phone_shows_state_map_and_pose_of_a_rover_at_once_and_nothing_is_too_wide(tmp_path: Path) -> None:
    port, page_port, stop = free_port(), free_port(), threading.Event()
    with publishing(settings_on(port)) as publisher:
        assert opened(publisher)

        def drive() -> None:
            seq = 0
            while not stop.is_set():
                put_ticks(publisher, range(seq, seq + 5), 0.1)
                seq += 5

        driving = threading.Thread(target=drive)
        driving.start()
        words = ("page", "--connect", f"tcp/127.0.0.1:{port}", "--port", str(page_port), "--runs", str(tmp_path))
        server = subprocess.Popen([sys.executable, "-m", "runtime.cli", *words], cwd=ROOT)
        try:
            with browser(tmp_path / "chrome") as page:
                assert until(lambda: listens(page_port), 60.0)
                page.open(f"http://127.0.0.1:{page_port}/")
                assert until(lambda: all(words in page.value(TEXT) for words in SHOWN), 60.0)
                assert page.value(TOO_WIDE) == []
                assert max(page.value(BOTTOMS)) <= PHONE[1]
        finally:
            stop.set()
            driving.join()
            server.terminate()
            server.wait(30)
