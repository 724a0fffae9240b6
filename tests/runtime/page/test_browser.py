"""A real Chromium draws the page at the width of a phone: `make browser`."""

import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from runtime.source_tree import ROOT
from tests.support.zenoh.wire import free_port, opened, publishing, put_ticks, settings_on, until

pytestmark = pytest.mark.browser
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is here")
def test_a_phone_shows_pose_and_events_of_a_rover(tmp_path: Path) -> None:
    assert CHROMIUM is not None
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
        options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=360,1200", "--timeout=15000"]

        def drawn() -> bool:
            dump = [CHROMIUM, *options, f"--user-data-dir={tmp_path / 'chrome'}", "--dump-dom"]
            url = f"http://127.0.0.1:{page_port}/"
            done = subprocess.run([*dump, url], capture_output=True, text=True, check=False)
            return all(words in done.stdout for words in (">r1</h1>", "uncertain by", "GB free"))

        try:
            assert until(drawn)
        finally:
            stop.set()
            driving.join()
            server.terminate()
            server.wait(30)
