"""The pages of the documentation in a real Chromium: `make browser`."""

import subprocess
import sys
from pathlib import Path

import pytest

from runtime.source_tree import ROOT
from tests.support.browser import PHONE, TOO_WIDE, browser, needs_chromium
from tests.support.zenoh.wire import until

pytestmark = [pytest.mark.browser, needs_chromium]
DESK = (1280, 800)
WIDE_TABLES = """[...document.querySelectorAll("article table")]
    .filter((each) => each.scrollWidth > each.parentElement.clientWidth).map((each) => each.textContent.slice(0, 80))"""


def test_no_page_is_wider_than_a_phone_and_no_table_than_its_page_on_a_desk(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "sphinx", "-q", "-d", str(tmp_path / "trees"), str(ROOT / "docs")]
    subprocess.run([*build, str(tmp_path / "html")], cwd=ROOT, check=True, capture_output=True)
    pages = sorted((tmp_path / "html").rglob("*.html"))
    assert len(pages) > 20
    with browser(tmp_path / "chrome") as page:
        for size_px, faults in ((PHONE, TOO_WIDE), (DESK, WIDE_TABLES)):
            for path in pages:
                page.open(path.as_uri(), size_px)
                drawn = f"document.readyState == 'complete' && location.href == '{path.as_uri()}'"
                assert until(lambda drawn=drawn: page.value(drawn), 60.0), path  # type: ignore[misc]
                assert page.value(faults) == [], (path.name, size_px)
