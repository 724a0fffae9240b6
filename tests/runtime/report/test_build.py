import html
import json
import math
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from runtime.cli.__main__ import app
from runtime.errors import NotARunError, StorageError
from runtime.report.build import build_report, is_as_grave
from runtime.report.compare import build_comparison
from runtime.report.figures import figures
from runtime.report.gather import gather
from runtime.report.page import page
from runtime.review.rebuild import drawn_meanwhile
from slam.estimate import Recognition
from tests.support.browser import browser, needs_chromium
from tests.support.runtime.seeded_runs import FAULTS, seeded_facts
from tests.support.zenoh.wire import until

CHROMIUM = shutil.which("chromium")
PAPER_PX = 700
DRAWN = "document.readyState == 'complete' && Bokeh.index.roots.every(each => each.is_idle)"
PRINTED = """[...document.querySelectorAll("[data-root-id]")].map(each => [each, each.previousElementSibling]).filter(
    ([each, copy]) => getComputedStyle(each).display != "none" || copy.getBoundingClientRect().right > innerWidth
    || !copy.getContext("2d").getImageData(0, 0, copy.width, copy.height).data.some(byte => byte)).length"""
FRAME = (  # a window of its own cannot be narrower than 500 px
    "<!doctype html><body style='margin:0'><iframe style='border:0;width:{width}px;height:2000px' srcdoc=\"{page}\" "
    'onload="setTimeout(()=>{{const w=this.contentWindow,d=this.contentDocument,b=w.Bokeh,'
    "m=n=>b.documents.map(x=>x.get_model_by_name(n)).find(x=>x);d.querySelector('button[data-start]').click();"
    "document.body.dataset.seen=[d.documentElement.scrollWidth,w.innerWidth,"
    "w.performance.getEntriesByType('resource').filter(r=>!r.name.startsWith('data:')).length,"
    "Object.keys(b.index).length||b.index.roots.length,m('picked').left,m('time').start,m('time').end,"
    "m('picked path').data.x.length].join(' ')}},3000)\"></iframe>"
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 15 s in which the laser's messages are damaged from the first seconds on."""
    folder = tmp_path_factory.mktemp("runs") / "damaged"
    seeded_facts(folder, 1, FAULTS["rate_low"][0], FAULTS["rate_low"][1], 15.0)
    return folder


def test_the_report_says_the_same_on_the_page_and_in_json(run: Path) -> None:
    report = build_report(run)
    page = (run / "report.html").read_text()
    data = json.loads((run / "report.json").read_text())
    assert data["findings"] == json.loads(json.dumps(report["findings"]))
    assert data["verdict"] in page
    for finding in data["findings"]:
        assert f'data-kind="{finding["kind"]}"' in page
        assert finding["cause"]
        assert finding["remedy"]
    assert data["accuracy"]["rms_m"] is not None
    assert data["timing"]["ticks"] == 150


def test_the_page_asks_nothing_of_the_network(run: Path) -> None:
    build_report(run)
    page = (run / "report.html").read_text()
    own = page.partition("<style>")[2].partition("<script")[0]  # what follows is the library, see the browser's test
    assert not re.search(r"(src|href)\s*=|url\(|@import", own)
    assert not re.search(r"<script[^>]*\ssrc|<link", page)


def test_recognitions_are_in_the_figures_and_on_the_page(run: Path) -> None:
    facts = gather(run)
    assert figures(facts, [])["recognitions"] == []
    found = Recognition(1, joined=2, odds=16.4, mirror_odds=-math.inf, matches=9, moved_m=35.8, turned_rad=-0.5)
    counts = dict(facts.ticks.counts)
    for row, recognition in ((40, Recognition(2, is_new=True)), (90, found)):
        for name, value in recognition.figures.items():
            counts.setdefault(name, np.full(facts.ticks.times_s.size, np.nan))[row] = value
    facts = replace(facts, ticks=replace(facts.ticks, counts=counts))
    made = figures(facts, [])
    new, recognised = made["recognitions"]
    assert (new["is_new"], new["map_id"]) == (True, 2)
    assert recognised["time_s"] == pytest.approx(facts.ticks.times_s[90], abs=0.01)
    assert (recognised["matches"], recognised["joined"], recognised["mirror_odds"]) == (9, 2, None)
    text = page(facts, [], made)
    for part in ("Recognitions", "map 1, joined by map 2", "35.80 m, -29 deg", "new map 2"):
        assert part in text


def test_fail_on_compares_severities() -> None:
    report = {"findings": [{"severity": "warn"}]}
    assert is_as_grave(report, "info")
    assert is_as_grave(report, "warn")
    assert not is_as_grave(report, "error")
    assert not is_as_grave({"findings": []}, "info")


def test_review_fails_on_what_it_was_told_to(run: Path) -> None:
    assert CliRunner().invoke(app, ["review", str(run), "--fail-on", "warn", "--json"]).exit_code == 1
    kept = CliRunner().invoke(app, ["review", str(run), "--fail-on", "error", "--json"])
    assert kept.exit_code == 0
    assert json.loads(kept.stdout)["severity"] == "warn"


def test_the_picture_that_is_drawn_meanwhile_has_the_verdict_and_none_is_left_where_the_report_fails(
    run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with drawn_meanwhile(run, tmp_path / "review.rrd") as finish:
        finish("healthy, says the test")
    assert b"healthy, says the test" in (tmp_path / "review.rrd").read_bytes()
    with pytest.raises(StorageError, match="no room"), drawn_meanwhile(run, tmp_path / "other.rrd"):
        raise StorageError("no room")
    with pytest.raises(StorageError, match="cannot be written"), drawn_meanwhile(run, tmp_path / "no" / "a") as finish:
        finish("")
    assert [path.name for path in tmp_path.iterdir()] == ["review.rrd"]
    assert "Traceback" not in capfd.readouterr().err  # of a process that is ended while it ends


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotARunError, match=r"no run\.mcap"):
        build_report(tmp_path)


def test_a_run_compared_with_another_shows_both_and_what_differs(run: Path, tmp_path: Path) -> None:
    seeded_facts(tmp_path / "other", 2, duration_s=15.0)
    result = build_comparison(run, tmp_path / "other", tmp_path / "two.html")
    page = (tmp_path / "two.html").read_text()
    assert {"key": "seed", "values": [1, 2]} in result["configuration"]
    assert result["verdicts"][1] == "healthy"
    assert result["verdicts"][0] != "healthy"
    assert run.name in page
    assert "other" in page
    assert json.loads((tmp_path / "two.json").read_text())["figures"]


@pytest.mark.browser
@pytest.mark.parametrize("width", [360, 1200])
def test_the_page_fits_a_phone_and_a_desk_in_a_real_browser(run: Path, tmp_path: Path, width: int) -> None:
    if CHROMIUM is None:
        pytest.skip("chromium is absent; apt-get install chromium")
    build_report(run)
    outer = tmp_path / "framed.html"
    outer.write_text(FRAME.format(width=width, page=html.escape((run / "report.html").read_text())))
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--window-size=1300,2000"]
    command += ["--virtual-time-budget=10000"]
    dom = subprocess.run(
        [*command, "--dump-dom", outer.as_uri()], capture_output=True, text=True, timeout=240, check=True
    ).stdout
    measured = re.search(r'data-seen="([-0-9. ]+)"', dom)
    assert measured is not None
    scroll_px, inner_px, resources, plots, picked_s, start_s, end_s, lit = map(float, measured[1].split())
    assert inner_px == width
    assert scroll_px <= width
    assert resources == 0
    assert plots > 8
    assert start_s <= picked_s <= end_s  # the button of the first finding: every plot shows its time
    assert lit > 0  # and the map its place
    picture = tmp_path / "page.png"
    subprocess.run([*command, f"--screenshot={picture}", outer.as_uri()], capture_output=True, timeout=240, check=True)
    assert picture.stat().st_size > 20_000


@pytest.mark.browser
@needs_chromium
def test_paper_shows_every_plot_to_its_right_edge(run: Path, tmp_path: Path) -> None:
    build_report(run)
    with browser(tmp_path / "chrome") as page:
        page.open((run / "report.html").as_uri(), (1280, 900))
        assert until(lambda: page.value(DRAWN), 60.0)
        page.print_on(PAPER_PX)
        assert page.value("document.querySelectorAll('.printed').length") > 8
        assert page.value(PRINTED) == 0
