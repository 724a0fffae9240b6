"""A page in a real Chromium at the size of a screen, asked in JavaScript through its debugging protocol."""

import asyncio
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from tornado.websocket import WebSocketClientConnection, websocket_connect

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is here; apt-get install chromium")
PHONE = (360, 740)  # px of a small one, with what the browser itself shows taken off
TOO_WIDE = """document.documentElement.scrollWidth <= screen.width ? [] : [...document.querySelectorAll("body *")]
    .filter((each) => each.getBoundingClientRect().right > screen.width).map((each) => `${each.tagName} ${each.id}`)"""
"""What makes a page wider than the screen; empty where it fits, as it does with a table that scrolls by itself."""


class Page:
    """One page of a browser, asked one question after the other."""

    def __init__(self, loop: asyncio.AbstractEventLoop, connection: WebSocketClientConnection) -> None:
        self._loop = loop
        self._connection = connection
        self._asked = 0

    def open(self, url: str, size_px: tuple[int, int] = PHONE) -> None:
        """Show another page at the size of a phone's screen."""
        width, height = size_px
        self._call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=2, mobile=True)
        self._call("Page.navigate", url=url)

    def value(self, expression: str) -> Any:
        """What a JavaScript expression has for a value there, once its promise is kept."""
        said = self._call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        return said["result"].get("value")

    def print_on(self, width_px: int) -> None:
        """Lay the page out as for paper of this width."""
        self.value("dispatchEvent(new Event('beforeprint'))")
        self._call("Emulation.setEmulatedMedia", media="print")
        self._call("Emulation.setDeviceMetricsOverride", width=width_px, height=1000, deviceScaleFactor=1, mobile=False)

    def _call(self, method: str, **parameters: object) -> Any:
        return self._loop.run_until_complete(self._answer(method, parameters))

    async def _answer(self, method: str, parameters: dict[str, object]) -> Any:
        self._asked += 1
        await self._connection.write_message(json.dumps({"id": self._asked, "method": method, "params": parameters}))
        while True:
            heard = json.loads(await self._connection.read_message() or "{}")
            if heard.get("id") == self._asked:
                return heard["result"]


@contextmanager
def browser(profile: Path) -> Iterator[Page]:
    """A Chromium with an empty page; profile: a folder that it may write into."""
    assert CHROMIUM is not None
    words = ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--remote-debugging-port=0")
    command = [CHROMIUM, *words, f"--user-data-dir={profile}", "about:blank"]
    loop = asyncio.new_event_loop()
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        try:
            socket = next(found[1] for line in process.stderr if (found := re.search(r"listening on (ws://\S+)", line)))
            yield loop.run_until_complete(_page(socket))
        finally:
            process.terminate()
            loop.close()


async def _page(browser_socket: str) -> Page:
    """The first page of a browser that listens there; only the names of the sockets differ."""
    to_browser = await websocket_connect(browser_socket)
    await to_browser.write_message(json.dumps({"id": 0, "method": "Target.getTargets"}))
    found = json.loads(await to_browser.read_message() or "{}")["result"]["targetInfos"]
    page = next(each["targetId"] for each in found if each["type"] == "page")
    address = browser_socket.split("/devtools")[0]
    connection = await websocket_connect(f"{address}/devtools/page/{page}", max_message_size=1 << 28)
    return Page(asyncio.get_running_loop(), connection)
